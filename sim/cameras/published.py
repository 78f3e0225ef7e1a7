"""Published figures of real cameras, as options of the camera models."""

from __future__ import annotations

PUBLISHED: dict[str, tuple[str, dict[str, float]]] = {
    "theta-sc": ("dual-fisheye", {"fov": 202.15558, "lens": 960, "baseline": 0.0179}),
    "tum-vi": (
        "fisheye",
        {
            "width": 512, "height": 512, "fov": 195.0, "fx": 190.97847715128717, "fy": 190.9733070521226, "cx": 254.93170605935475,
            "cy": 256.8974428996504, "k1": 0.0034823894022493434, "k2": 0.0007150348452162257, "k3": -0.0020532361418706202,
            "k4": 0.00020293673591811182,
        },
    ),
    "euroc": (
        "pinhole",
        {
            "width": 752, "height": 480, "fx": 458.654, "fy": 457.296, "cx": 367.215, "cy": 248.375, "k1": -0.28340811, "k2": 0.07395907,
            "p1": 0.00019359, "p2": 1.76187114e-05,
        },
    ),
}  # fmt: skip
"""Name → its model and options, in the units of sim.cameras.specification.

theta-sc: Ricoh Theta SC. Equidistant lenses of 202.15558°, round images of radius 480 px in a video of 1920 x 1080, as measured at
https://monochrome.sutic.nu/2017/08/03/ricoh-theta-sc-lens-parameters.html. The distance of its lenses is not published.
The baseline is the thickness of a Theta V without its lenses, 17.9 mm (https://theta360.com/en/etc/technology.html).
tum-vi: left camera of the TUM VI data set, 512 x 512, with its calibration
(Schubert et al., The TUM VI Benchmark for Evaluating Visual-Inertial Odometry, IROS 2018; field of view of its lens: 195°).
euroc: left camera of the EuRoC data set, an MT9V034 with a global shutter, with the calibration of its sensor.yaml
(Burri et al., The EuRoC micro aerial vehicle datasets, IJRR 2016).
"""
