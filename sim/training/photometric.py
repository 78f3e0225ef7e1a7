"""Photometric augmentation: light, colour, lens, sensor and compression of a camera. All parameters are drawn from a generator."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

GREY = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of red, green and blue in luma (ITU-R BT.601)."""


def camera_look(picture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """A picture (H, W, 3) RGB as another camera would show it: light and colour, then lens, sensor and compression."""
    light = _colours(picture.astype(np.float32), rng)
    light = _lens(light, rng)
    if rng.random() < 0.5:
        light = _sensor(light, rng)
    shown = light.clip(0, 255).astype(np.uint8)
    if rng.random() < 0.45:
        quality = int(rng.integers(20, 92))
        _, coded = cv2.imencode(".jpg", shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        shown = np.ascontiguousarray(np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)[..., ::-1])
    return shown


def _colours(light: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    gain = np.float32(2.0 ** rng.normal(0.0, 0.5)) * np.exp(rng.normal(0.0, 0.07, 3)).astype(np.float32)
    light = np.asarray(light * gain, np.float32)
    if rng.random() < 0.6:
        saturation = np.float32(rng.uniform(0.25, 1.35))
        grey = (light @ GREY)[..., None]
        light = np.asarray(grey + saturation * (light - grey), np.float32)
    if rng.random() < 0.06:
        light = np.repeat((light @ GREY)[..., None], 3, axis=2)
    if rng.random() < 0.5:
        gamma = np.float32(np.exp(rng.normal(0.0, 0.25)))
        table = (255 * (np.arange(256) / 255) ** gamma).astype(np.float32)
        light = table[light.clip(0, 255).astype(np.uint8)]
    contrast, offset = np.float32(rng.uniform(0.6, 1.25)), np.float32(rng.normal(0.0, 12.0))
    light = (light - 118) * contrast + 118 + offset
    if rng.random() < 0.15:
        veil = np.float32(rng.uniform(0.1, 0.5))
        light = light * (1 - veil) + veil * rng.uniform(120, 245, 3).astype(np.float32)
    return light


def _lens(light: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    height, width = light.shape[:2]
    if rng.random() < 0.2:
        factor = rng.uniform(0.4, 0.9)
        small = cv2.resize(light, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        light = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
    if rng.random() < 0.3:
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), rng.uniform(0.4, 1.8)), np.float32)
    if rng.random() < 0.08:
        length = int(rng.integers(2, 8))
        kernel = np.zeros((9, 9), np.float32)
        angle = rng.uniform(0, np.pi)
        end = np.array([np.cos(angle), np.sin(angle)]) * length / 2
        cv2.line(kernel, tuple(np.rint(4 - end).astype(int).tolist()), tuple(np.rint(4 + end).astype(int).tolist()), 1.0)
        light = np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum()), np.float32)
    if rng.random() < 0.35:
        amount = np.float32(rng.uniform(0.3, 2.2))
        light = np.asarray(light + amount * (light - cv2.GaussianBlur(light, (0, 0), rng.uniform(0.7, 2.0))), np.float32)
    return light


def _sensor(light: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """White noise, of luma alone or of every channel, sometimes of two pixels' width."""
    height, width = light.shape[:2]
    noise = rng.standard_normal((height, width, 1 if rng.random() < 0.5 else 3), np.float32)
    if rng.random() < 0.3:
        noise = np.asarray(2 * cv2.blur(noise, (2, 2)), np.float32).reshape(noise.shape)
    return light + np.float32(abs(rng.normal(0.0, 9.0))) * noise


def recoloured(picture: NDArray[np.uint8], instances: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The picture with the colours of some people changed, often to darker ones."""
    out = picture.copy()
    for person in np.unique(instances[instances > 0]).tolist():
        if rng.random() < 0.5:
            continue
        mine = instances == person
        gain = np.exp(rng.normal(-0.45, 0.5)) * np.exp(rng.normal(0.0, 0.25, 3))
        body = picture[mine].astype(np.float32)
        grey = (body @ GREY)[:, None]
        body = (grey + rng.uniform(0.0, 1.2) * (body - grey)) * gain + rng.uniform(0, 20)
        out[mine] = body.clip(0, 255).astype(np.uint8)
    return out
