"""Detector models fitted to the first half of recordings, and how far their boxes are from the real ones of the second half.

The frames of the fit are 0:130 of CMC and 0:400 of PETS 2009; those of the test follow. Simulated boxes are of three seeds together.
"""

from __future__ import annotations

from tests.conftest import DATA
from tracker.detector_models.comparison import distances, table
from tracker.detector_models.fitting import agreed_source, open_source
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import named_model
from tracker.detector_models.samples import joined
from tracker.detector_models.simulation import simulated_detections
from tracker.formats.source_options import SourceOptions

SEEDS = (1, 2, 3)
CMC, PETS = [DATA / "cmc" / "CMC1", DATA / "cmc" / "CMC2"], [DATA / "pets2009" / "S2.L1"]
ROWS = {
    "fairmot": (CMC, "130:261", "", ""),
    "faster-rcnn": (CMC, "130:261", "", "detections-faster-rcnn"),
    "keypoint-rcnn": (PETS, "400:795", "1", ""),
    "pets-det": (PETS, "400:795", "1", "1=mot15/det.txt"),
}
"""Name of a model → sources, frames, cameras and detections of the test."""


def compared(name: str) -> dict[str, dict[str, float]]:
    """Detector → statistic → distance from the real boxes of the second half."""
    paths, frames, cameras, text = ROWS[name]
    model, sources = named_model(name), []
    for path in paths:
        camera, equals, file = text.rpartition("=")
        given = [f"{camera}{equals}{path / file}"] if text else []
        sources.append(agreed_source(open_source(path, SourceOptions.parse(given, cameras=cameras, frames=frames))))
    real, filled = joined([source.samples() for source in sources]), (model.edges.hidden, model.edges.border)
    own = joined([s.samples(simulated_detections(s.recording, s.truth, model, seed)) for s in sources for seed in SEEDS])
    plain = joined([s.samples(simulated_detections(s.recording, s.truth, IndependentErrors(), seed)) for s in sources for seed in SEEDS])
    return {name: distances(real, own, filled), "independent": distances(real, plain, filled)}


def main() -> None:
    for name in ROWS:
        missing = [path for path in ROWS[name][0] if not path.is_dir()]
        if missing:
            print(f"{name}: needs {missing[0]}")
            continue
        print("\n".join(table(compared(name))), end="\n\n")


if __name__ == "__main__":
    main()
