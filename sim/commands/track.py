"""From views to tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional

from sim.commands.options import Out, numbers, unset

if TYPE_CHECKING:
    from tracker.pipeline import Parameters
    from tracker.seeing import ImageParameters


@dataclass(frozen=True)
class Track:
    """Track people in a sequence made by pilsim, or in a PETS 2009 folder; or place the robots of a UTIAS set (MRCLAM).

    A PETS folder has annotations/*-cropped.xml, detections/View_00N.txt (MOT15), and calibration/ in it or beside it.

    Examples: pilsim track PETS2009/S2.L1 --views 1,5,7 --out runs/pets
              pilsim track MRCLAM_Dataset1 --map unknown --out runs/utias
    """

    source: Positional[Path]
    """The folder to track."""
    out: Out
    """Where tracks.txt (MOT15, metres) and robots.csv go."""
    views: str = ""
    """Numbers of the PETS cameras to use, as in 1,5,7; all where it is empty."""
    detections: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """VIEW=FILE: other detections (MOT15) for a PETS camera; may be given several times."""
    degrade: str = ""
    """drop=P,clutter=N,noise=PX: PETS detections made worse: a share lost, false boxes a view and frame, pixels that boxes are moved by."""
    seed: int = 0
    """Of what --degrade draws."""
    delay: int = 0
    """Frames that a frame is told late; people are smoothed by what came since."""
    images: bool = False
    """Look at the images, too: silhouettes of people before cameras that stand still are a second detector there; what people look like tells them
    apart (multiple), or corners of their boxes that are followed back do, tracklets (single). A PETS folder has video/View_00N.mp4, of some views at
    least."""
    l_c: Annotated[int | None, unset("INT", "4")] = None
    """L_c: frames that corners are followed back (images, single)."""
    delta_min: Annotated[float | None, unset("FLOAT", "0.05")] = None
    """δ_min: a corner that moves less is static, px of the image at half its size (images, single)."""
    omega: Annotated[float | None, unset("FLOAT", "0.3")] = None
    """ω: corners of one body move alike within this share of its box's width (images, single)."""
    hypotheses: Literal["single", "multiple"] = "single"
    """Whether one best hypothesis on people is kept, or track trees with the best set of tracks as a maximum-weight clique."""
    k_h: Annotated[int | None, unset("INT", "one graph of all tracks")] = None
    """K_H: hypotheses kept; where it is given, the children of each are a graph of their own (multiple)."""
    i_bls_max: Annotated[int | None, unset("INT", "2000")] = None
    """Moves of the clique search at most (multiple)."""
    seed_search: int = 0
    """Of the clique search (multiple)."""
    dump_graphs: Annotated[Path | None, unset("DIR", "nowhere")] = None
    """Where every weighted graph that is solved is written (DIMACS), beside the clique that was chosen (multiple)."""
    theta_s: Annotated[float | None, unset("FLOAT", "1.0")] = None
    """θ_s: two tracks nearer than this that no view tells apart are one person, m."""
    n_scan: Annotated[float | None, unset("FLOAT", "1.43")] = None
    """Time after which a decision stands, s (multiple)."""
    v_max: Annotated[float | None, unset("FLOAT", "3.0")] = None
    """v_max: nobody goes faster, m/s; a track that does is dropped."""
    delta_a: Annotated[float | None, unset("FLOAT", "1.29")] = None
    """Longest gap that is bridged, s."""
    n_conf: Annotated[int | None, unset("INT", "2")] = None
    """Frames until a track may be believed."""
    map: Literal["known", "unknown"] = "unknown"
    """UTIAS: whether the filter is told where the landmarks are."""
    slam: Annotated[Literal["ekf", "iekf", "fej", "invariant"] | None, unset("{ekf,iekf,fej,invariant}", "fej; UTIAS: invariant")] = None
    """The filter of the robots' places: extended, iterated, with first-estimates Jacobians, or with the right-invariant error."""
    iterations: Annotated[int | None, unset("INT", "2")] = None
    """Linearisations of an update; ekf has one."""
    correction: Literal["on", "off"] = "on"
    """Whether each robot's correction factor is estimated."""
    persistence: Annotated[Literal["on", "off"] | None, unset("{on,off}", "on with fej")] = None
    """Whether errors of odometry that last (slip, biases) are kept in the state; for fej or iekf."""
    unknown_start: str = ""
    """Robots, as in robot_1,robot_2, that are not told where they start: each maps alone until it has enough in common with the others."""

    def run(self) -> None:
        from sim.demo import tracked
        from tracker.films import filmed
        from tracker.formats.utias import is_utias
        from tracker.sequence import without_starts
        from tracker.sources import Choice, open_source

        views = numbers(self.views)
        if is_utias(self.source):
            if views:
                raise ValueError(f"{self.source}: --views chooses PETS cameras; a UTIAS set has none")
            if self.unknown_start:
                raise ValueError(f"{self.source}: --unknown-start is for sequences; the robots of a UTIAS set start where their truth begins")
            if self.persistence == "on":
                raise ValueError(f"{self.source}: --persistence is for sequences; biases of a UTIAS set are in the correction factor")
            self._explore()
            return
        if self.map != "unknown":
            raise ValueError(f"{self.source}: --map is for UTIAS sets (Barcodes.dat), and this is none")
        choice = Choice.parse(self.detections, self.degrade, self.seed)
        sequence = open_source(self.source, views, choice)
        lost = [name.strip() for name in self.unknown_start.split(",") if name.strip()]
        sequence = without_starts(sequence, lost)
        if self.images:
            sequence = filmed(sequence, self.source)
        run = {"source": self.source.name, "views": views} | choice.to_run() | ({"unknown_start": lost} if lost else {})
        results = tracked(sequence, self.out, run, self._parameters())
        people = len({identity for ids, _ in results.tracks.values() for identity in ids.tolist()})
        print(f"{self.out}: {people} people in {results.frames} frames; `pilsim score {self.source} {self.out}` scores it")

    def _parameters(self) -> Parameters | None:
        """What was asked of the filter, for a sequence; None where nothing was."""
        from sim.contender import filter_of
        from tracker.pipeline import Parameters

        people = self._people()
        if self.slam is None and self.iterations is None and self.correction == "on" and self.persistence is None:
            return people
        lasting = None if self.persistence is None else self.persistence == "on"
        chosen = filter_of(self.slam, self.iterations, self.correction == "on", lasting)
        return replace(people or Parameters(), slam=chosen)

    def _people(self) -> Parameters | None:
        """What was asked of the tracker of people; None where nothing was."""
        from tracker.pipeline import Parameters
        from tracker.selection import MultipleParameters

        names = ("k_h", "i_bls_max", "delta_a", "n_conf", "theta_s", "n_scan", "v_max")
        given = {name: getattr(self, name) for name in names}
        given = {name: value for name, value in given.items() if value is not None}
        for name, value in given.items():
            if not value > 0:
                raise ValueError(f"--{name.replace('_', '-')} is {value}, needs more than 0")
        if "theta_s" in given:
            given["same_person"] = given.pop("theta_s")
        v_max, images = given.pop("v_max", None), self._images()
        single, many = Parameters().targets, MultipleParameters()
        if v_max is not None:
            single = replace(single, motion=replace(single.motion, v_max=v_max))
            many = replace(many, motion=replace(many.motion, v_max=v_max))
        if self.hypotheses == "multiple":
            others: dict[str, Any] = {"small_graphs": self.k_h is not None, "seed": self.seed_search, "graphs": self.dump_graphs}
            return Parameters(multiple=replace(many, **given, **others), images=images, delay=self.delay)
        if {"k_h", "i_bls_max", "n_scan"} & set(given) or self.dump_graphs is not None or self.seed_search:
            raise ValueError("--k-h, --i-bls-max, --n-scan, --seed-search and --dump-graphs are for --hypotheses multiple")
        if not given and v_max is None and not self.delay and not self.images:
            return None
        return Parameters(targets=replace(single, **given), images=images, delay=self.delay)

    def _images(self) -> ImageParameters:
        """What is looked for in images."""
        from tracker.seeing import ImageParameters
        from tracker.silhouettes import SilhouetteParameters
        from tracker.tracklets import TrackletParameters

        given = {name: getattr(self, name) for name in ("l_c", "delta_min", "omega") if getattr(self, name) is not None}
        multiple = self.hypotheses == "multiple"
        if given and (multiple or not self.images):
            raise ValueError("--l-c, --delta-min and --omega are for --images with --hypotheses single")
        if not self.images:
            return ImageParameters()
        return ImageParameters(None if multiple else TrackletParameters(**given), SilhouetteParameters(), appearance=multiple)

    def _explore(self) -> None:
        from tracker.course import PlanarParameters
        from tracker.expedition import explore

        asked = {"mode": self.slam, "iterations": self.iterations, "correction": self.correction == "on"}
        parameters = PlanarParameters(**{name: value for name, value in asked.items() if value is not None})  # type: ignore[arg-type]
        paths = explore(self.source, self.out, self.map == "known", parameters)
        counted = ", ".join(f"{count} {reason}" for reason, count in paths.run["counters"].items() if count)
        for mended in paths.run["mended"]:
            print(mended)
        print(f"{self.out}: {len(paths.poses)} robots at {len(paths.times)} times ({counted}); `pilsim score {self.source} {self.out}` scores it")
