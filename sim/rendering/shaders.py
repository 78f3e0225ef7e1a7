"""Shaders in GLSL with MuJoCo's lights, their uniforms, and the projection matrices of views and shadow maps.

Lambert and Blinn reflection are computed at the vertices with MuJoCo's terms (OpenGL 2.1 specification, 2.14), shadows at the pixels.
All programs compute positions by the same source text, so that their depths agree bit by bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.rendering.draw_list import CUBE_MAPPED, FACETS, PLAIN, TEXTURED, TEXTURED_FACETS
from tracker.geometry import Array, Pose
from worlds.engine import mujoco

MOST_LIGHTS = 8
"""Largest number of lights, as in MuJoCo."""

INPUTS = """#version 430
layout(location = 0) in vec4 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 coordinates;
layout(location = 3) in vec4 row0;
layout(location = 4) in vec4 row1;
layout(location = 5) in vec4 row2;
layout(location = 6) in vec4 scale;
layout(location = 7) in vec4 rgba;
layout(location = 8) in vec4 shine;
layout(location = 9) in vec4 mapping;
layout(location = 10) in uvec2 marks;
uniform mat4 projection;
invariant gl_Position;
vec3 placed() {
  vec4 local = vec4(position.xyz * scale.xyz + vec3(0, 0, position.w * scale.w), 1);
  return vec3(dot(row0, local), dot(row1, local), dot(row2, local));
}
"""

LIT_VERTEX = """
struct Light { vec4 place; vec4 way; vec4 ambient; vec4 diffuse; vec4 specular; vec4 fading; };
uniform vec4 lights[6 * LIGHTS + 1];
uniform mat4 shadows[SHADOWS + 1];
uniform vec4 eye;
LEVEL out vec3 steady;
LEVEL out vec3 shadowed[SHADOWS + 1];
out vec4 fallen[SHADOWS + 1];
out vec3 uvw;
flat out float alpha;
flat out uint code;
vec3 shone(int k, vec3 at, vec3 up, vec3 back) {
  Light light = Light(lights[6 * k], lights[6 * k + 1], lights[6 * k + 2], lights[6 * k + 3], lights[6 * k + 4], lights[6 * k + 5]);
  vec3 to = mix(-light.way.xyz, light.place.xyz - at, light.place.w);
  float far = length(to);
  to /= far;
  float aligned = dot(-to, light.way.xyz);
  float strength = light.place.w == 0 ? 1 : 1 / (light.fading.x + far * (light.fading.y + far * light.fading.z));
  if (light.place.w != 0 && light.way.w > -1) strength *= aligned < light.way.w ? 0 : pow(max(aligned, 1e-6), light.fading.w);
  float facing = max(dot(up, to), 0);
  vec3 sum = rgba.rgb * (light.ambient.rgb + facing * light.diffuse.rgb);
  if (facing > 0 && shine.y > 0) sum += pow(max(dot(up, normalize(to + back)), 1e-6), shine.z) * shine.y * light.specular.rgb;
  return strength * sum;
}
void main() {
  vec3 at = placed();
  gl_Position = projection * vec4(at, 1);
  vec3 local = normal / scale.xyz;
  vec3 up = normalize(vec3(dot(row0.xyz, local), dot(row1.xyz, local), dot(row2.xyz, local)));
  vec3 back = normalize(eye.xyz - at);
  steady = rgba.rgb * (shine.x + eye.w);
  for (int k = SHADOWS; k < LIGHTS; ++k) steady += shone(k, at, up, back);
  steady = min(steady, 1);
  for (int k = 0; k < SHADOWS; ++k) {
    shadowed[k] = min(shone(k, at, up, back), 1);
    fallen[k] = shadows[k] * vec4(at + lights[6 * k + 2].w * up, 1);
  }
  alpha = rgba.a;
  code = marks.x;
  uvw = KIND == 2 ? position.xyz * mapping.xyz : vec3(mapping.w > 0 ? position.xy * mapping.xy - 0.5 : coordinates, 0);
}
"""

LIT_FRAGMENT = """#version 430
LEVEL in vec3 steady;
LEVEL in vec3 shadowed[SHADOWS + 1];
in vec4 fallen[SHADOWS + 1];
in vec3 uvw;
flat in float alpha;
flat in uint code;
layout(location = 0) out vec4 colour;
layout(location = 1) out uint seen;
layout(binding = 0) uniform PICTURES picture;
layout(binding = 1) uniform sampler2DShadow hidden[SHADOWS + 1];
void main() {
  vec3 light = steady;
  for (int k = 0; k < SHADOWS; ++k) {
    // Surfaces that face away from the light need no shadow lookup.
    if (shadowed[k].r + shadowed[k].g + shadowed[k].b > 0) {
      vec3 place = fallen[k].xyz / fallen[k].w;
      light += shadowed[k] * texture(hidden[k], vec3(place.xy, min(place.z, 1)));
    }
  }
  colour = vec4(light TEXTURED, alpha);
  seen = code;
}
"""

DEPTH_VERTEX = "\nvoid main() { gl_Position = projection * vec4(placed(), 1); }\n"
DEPTH_FRAGMENT = "#version 430\nvoid main() {}\n"
MARK_VERTEX = "\nflat out uint mark;\nvoid main() { gl_Position = projection * vec4(placed(), 1); mark = marks.y; }\n"
MARK_FRAGMENT = "#version 430\nflat in uint mark;\nlayout(location = 0) out uint bits;\nvoid main() { bits = mark; }\n"
SKY_VERTEX = """#version 430
uniform mat3 ways;
uniform vec4 window;
out vec3 way;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1);
  way = ways * vec3(1, mix(window.xy, window.zw, 0.5 * corner + 0.5));
  gl_Position = vec4(corner, 0, 1);
}
"""
SKY_FRAGMENT = """#version 430
in vec3 way;
layout(location = 0) out vec4 colour;
layout(location = 1) out uint seen;
layout(binding = 0) uniform samplerCube picture;
void main() { colour = vec4(texture(picture, vec3(way.x, way.z, -way.y)).rgb, 1); seen = 0; }
"""


def programs(lights: int, shadows: int) -> dict[int, tuple[str, str]]:
    """Kind of surface → source of its vertex and fragment shader. The first `shadows` of `lights` lights cast shadows."""
    texts = {}
    for kind, pictures, textured in (
        (PLAIN, "sampler2D", ""),
        (TEXTURED, "sampler2D", "* texture(picture, uvw.xy).rgb"),
        (CUBE_MAPPED, "samplerCube", "* texture(picture, uvw).rgb"),
        (FACETS, "sampler2D", ""),
        (TEXTURED_FACETS, "sampler2D", "* texture(picture, uvw.xy).rgb"),
    ):
        vertex, pixel = INPUTS + LIT_VERTEX, LIT_FRAGMENT.replace("PICTURES", pictures).replace("TEXTURED", textured)
        for name, number in (("LIGHTS", lights), ("SHADOWS", shadows), ("KIND", kind)):
            vertex, pixel = vertex.replace(name, str(number)), pixel.replace(name, str(number))
        flat = "flat " if kind in (FACETS, TEXTURED_FACETS) else ""
        vertex, pixel = vertex.replace("LEVEL ", flat), pixel.replace("LEVEL ", flat)
        texts[kind] = vertex, pixel
    return texts


@dataclass(frozen=True, eq=False)
class Lights:
    """The active lights of a model, those that cast shadows first. The headlight, if active, is the last and sits at the camera.

    index (n,): of each light in the model, −1 for the headlight. shadows: how many cast shadows.
    parameters (n, 6, 4): uniforms of the programs without position and direction. ambient: ambient light if there are no lights.
    """

    index: NDArray[np.int64]
    shadows: int
    parameters: NDArray[np.float32]
    directional: NDArray[np.bool_]
    ambient: float

    @staticmethod
    def of(model: mujoco.MjModel) -> Lights:
        """Raises ValueError for more than MOST_LIGHTS lights, or for an unsupported kind of light."""
        on = np.flatnonzero(model.light_active)
        order = on[np.argsort(~model.light_castshadow[on].astype(bool), kind="stable")]
        headlight = bool(model.vis.headlight.active)
        if len(on) + headlight > MOST_LIGHTS:
            raise ValueError(f"the model has {len(on) + headlight} lights, needs at most {MOST_LIGHTS}")
        kinds = mujoco.mjtLightType
        directional = model.light_type[order] == kinds.mjLIGHT_DIRECTIONAL
        if not (directional | np.isin(model.light_type[order], [int(kinds.mjLIGHT_SPOT), int(kinds.mjLIGHT_POINT)])).all():
            raise ValueError("a light of the model is neither directional nor a spot nor a point light, needs to be one of them")
        parameters = np.zeros((len(order) + headlight, 6, 4), np.float32)
        for k, light in enumerate(order):
            beam = model.light_type[light] == kinds.mjLIGHT_SPOT and model.light_cutoff[light] < 180
            parameters[k, 0, 3], parameters[k, 1, 3] = not directional[k], np.cos(np.radians(model.light_cutoff[light])) if beam else -1
            parameters[k, 2:5, :3] = model.light_ambient[light], model.light_diffuse[light], model.light_specular[light]
            parameters[k, 5] = *model.light_attenuation[light], model.light_exponent[light]
        if headlight:
            shown = model.vis.headlight
            parameters[-1, 0, 3], parameters[-1, 1, 3], parameters[-1, 5, 0] = 1, -1, 1
            parameters[-1, 2:5, :3] = shown.ambient, shown.diffuse, shown.specular
        casting = int(model.light_castshadow[order].astype(bool).sum())
        return Lights(
            np.append(order, [-1] * headlight), casting, parameters, np.append(directional, [False] * headlight), 0.0 if len(parameters) else 0.3
        )

    def parameters_at(self, data: mujoco.MjData, eye: Array) -> NDArray[np.float32]:
        """The uniforms (n, 6, 4) in the state `data`, for a camera at `eye` (3,) m, world."""
        parameters = self.parameters.copy()
        parameters[:, 0, :3] = np.where(self.index[:, None] < 0, eye, data.light_xpos[self.index] if len(data.light_xpos) else eye)
        parameters[:, 1, :3] = np.where(self.index[:, None] < 0, [0, 0, -1], data.light_xdir[self.index] if len(data.light_xdir) else 0)
        return parameters


def projection(pose: Pose, axes: Array, edges: Array, planes: tuple[float, float]) -> Array:
    """Projection (4, 4) from world to OpenGL's clip space with reversed depth: 1 at planes[0] (near), 0 at planes[1] (far), m.

    axes (3, 3): forward, right, up, camera frame. edges (4,): lowest tangents to the right and up, then the highest.
    """
    near, far = planes
    forward, right, up = axes @ pose.rotation.T
    scale, centre = 2 / (edges[2:] - edges[:2]), (edges[2:] + edges[:2]) / (edges[2:] - edges[:2])
    depth = -near / (far - near)
    rows = np.stack([scale[0] * right - centre[0] * forward, scale[1] * up - centre[1] * forward, depth * forward, forward])
    offset = -rows @ pose.translation
    offset[2] += near * far / (far - near)
    return np.column_stack([rows, offset])


def shadow_view(light: Array, beam: float | None, points: Array) -> Array:
    """Projection (4, 4) from world to the clip space of a shadow map around points (n, 3) m. Depth grows from 0 to 1 away from the light.

    light (6,): position m and direction. beam: None for parallel light, else the half angle of a spot's cone, rad.
    Bounds are whole metres, so that shadow edges stay still while bodies move.
    """
    direction = light[3:] / np.linalg.norm(light[3:])
    right = np.cross(direction, [0.0, 0.0, 1.0] if abs(direction[2]) < 0.9 else [1.0, 0.0, 0.0])
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, direction), direction])
    if beam is None:
        at = points @ axes.T
        low, high = np.floor(at.min(axis=0)) - 0.5, np.ceil(at.max(axis=0)) + 0.5
        middle, scale = (low + high) / 2 * [1, 1, 0] + low * [0, 0, 1], np.array([2.0, 2.0, 1.0]) / (high - low)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = scale[:, None] * axes, -scale * middle
        return matrix
    near, far = 0.05, max(1.0, float(np.linalg.norm(points - light[:3], axis=1).max()))
    tangent = np.tan(min(beam, np.radians(80.0)))
    rows = np.stack([axes[0] / tangent, axes[1] / tangent, far / (far - near) * axes[2], axes[2]])
    offset = -rows @ light[:3]
    offset[2] -= far * near / (far - near)
    return np.column_stack([rows, offset])
