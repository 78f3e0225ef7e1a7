"""Camera models, from pixels to unit directions and back.

`panoramas.py` holds Panorama (equirectangular) and Cylinder, `lenses.py` OpenCV's Pinhole and Fisheye, and `tsai.py` Tsai.

The frame of a camera is that of a body: x forward, y left, z up. Only pinhole and fisheye models use the optical frame (x right, y down, z forward).
Pixel centres lie at +½ in panoramic images, and at whole numbers in the other models, as OpenCV and Tsai's calibration files define.
"""

from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA, Camera
from tracker.geometry.lenses import Fisheye, LensCamera, Pinhole
from tracker.geometry.panoramas import Cylinder, Panorama, PanoramicCamera
from tracker.geometry.tsai import PIXEL_PITCH, Tsai, pinhole

__all__ = [
    "OPTICAL_FROM_CAMERA",
    "PIXEL_PITCH",
    "Camera",
    "Cylinder",
    "Fisheye",
    "LensCamera",
    "Panorama",
    "PanoramicCamera",
    "Pinhole",
    "Tsai",
    "pinhole",
]
