# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Linear pictures of a laser stripe on a part, direct light and light that went on apart.

Direct light is path-traced with emitter sampling (``path``, two segments). What is reflected more
than once comes from a particle tracer (``ptracer``), which starts in the light sheet and connects
every reflection to the camera: a path from the camera would hardly ever meet the sheet.
"""

import os
from pathlib import Path
import re
from typing import Any

import cv2
import numpy as np

from bench.metal.materials import grain_directions
from bench.metal.rigs import Rig
from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.render.camera_rays import pixel_rays
from ivfmc_ros.simulation.render.scene import part_from_camera
from ivfmc_ros.simulation.render.scene import Scene

VARIANT = 'llvm_ad_mono'
_LEAST_LLVM = 19
# Part of the names of kept pictures: to be raised with each change of this file that they show.
VERSION = 1
PLATTER = Platter(radius=0.06)
_PLATTER_REFLECTANCE = 0.06  # a black, matt disc
_SEGMENTS = 6  # of the longest path: four reflections
_DIRECT_SAMPLES = 9  # rays a pixel
# Light that went on is smooth: pixels that are rendered as one, and particles for each of these.
_BINNED, _PARTICLES = 2, 2
_MARGIN = 14  # pixels around the stripe that are traced for direct light
# The sheet in texels: sigmas to each side, texels a sigma, and along it.
_SIGMAS, _TEXELS, _LONG = 4.0, 6, 4096
_BLUR = 2.0  # pixels, of the light of the particles, within faces of one direction
_POWER = 1000.0
_AIM = 0.02  # meters above the platter, where the lasers shine at


class PathTracer:
    """Traces a part of one material in a rig; the part may turn from picture to picture."""

    def __init__(self, rig: Rig, solid: Solid, bsdf: dict[str, Any]) -> None:
        mitsuba = _mitsuba()
        self._mi = mitsuba
        self._rig, self._solid, self._bsdf = rig, solid, bsdf
        self._base_from_camera = transforms.invert(rig.cell.turntable.camera_from_base)

    def light(
        self, angle: float, laser: int, stripe_uv: Floats, seed: int
    ) -> tuple[Singles, Singles]:
        """
        Return direct light and light that went on, (height, width) each, arbitrary linear unit.

        stripe_uv : (n, 2) pixels where the stripe is seen, see ``StripeRenderer.truth``
        """
        mi = self._mi
        size = self._rig.cell.camera.size
        corner = np.maximum(np.floor(stripe_uv.min(axis=0)).astype(int) - _MARGIN, 0)
        end = np.minimum(np.ceil(stripe_uv.max(axis=0)).astype(int) + _MARGIN + 1, size)
        scene = self._scene(angle, laser, corner, end - corner)
        direct = np.zeros(size[::-1], dtype=np.float32)
        picture = mi.render(
            scene,
            sensor=0,
            integrator=mi.load_dict({'type': 'path', 'max_depth': 2}),
            spp=_DIRECT_SAMPLES,
            seed=seed,
        )
        direct[corner[1] : end[1], corner[0] : end[0]] = np.array(picture)[..., 0]
        every, first = (self._particles(scene, segments, seed) for segments in (_SEGMENTS, 2))
        more = cv2.resize(every - first, tuple(size), interpolation=cv2.INTER_LINEAR)
        return direct, _blurred(more, self._faces(angle))

    def _particles(self, scene: Any, segments: int, seed: int) -> Singles:
        # the same seed gives the same first reflections, which the difference takes away
        integrator = {'type': 'ptracer', 'max_depth': segments, 'rr_depth': 1000}
        picture = self._mi.render(
            scene,
            sensor=1,
            integrator=self._mi.load_dict(integrator),
            spp=_PARTICLES,
            seed=seed,
        )
        return np.array(picture)[..., 0].astype(np.float32)

    def _scene(self, angle: float, laser: int, corner: Any, extent: Any) -> Any:
        disc = {
            'type': 'disk',
            'to_world': self._mi.ScalarTransform4f().scale(PLATTER.radius),
            'bsdf': {'type': 'diffuse', 'reflectance': _PLATTER_REFLECTANCE},
        }
        crop = {
            'crop_offset_x': int(corner[0]),
            'crop_offset_y': int(corner[1]),
            'crop_width': int(extent[0]),
            'crop_height': int(extent[1]),
        }
        return self._mi.load_dict(
            {
                'type': 'scene',
                'part': self._part(angle),
                'platter': disc,
                'direct': self._sensor(1, crop),
                'whole': self._sensor(_BINNED, {}),
                'laser': self._projector(laser),
            }
        )

    def _part(self, angle: float) -> Any:
        mi, solid = self._mi, self._solid
        corners = solid.vertices_xyz @ transforms.rotation_z(angle).T
        corners = corners[solid.faces].reshape(-1, 3)
        properties = mi.Properties()
        properties['bsdf'] = mi.load_dict({'type': 'twosided', 'bsdf': self._bsdf})
        count = len(corners)
        mesh = mi.Mesh(
            'part', count, len(solid.faces), has_vertex_texcoords=True, props=properties
        )
        # coordinates along and across the marks of grinding
        normals = np.repeat(solid.normals @ transforms.rotation_z(angle).T, 3, axis=0)
        along = grain_directions(normals)
        across = np.cross(normals, along)
        texture = np.stack([(corners * along).sum(axis=1), (corners * across).sum(axis=1)], axis=1)
        values = mi.traverse(mesh)
        values['vertex_positions'] = corners.ravel().astype(np.float32)
        values['vertex_texcoords'] = texture.ravel().astype(np.float32)
        values['faces'] = np.arange(count, dtype=np.uint32)
        values.update()
        return mesh

    def _sensor(self, binned: int, crop: dict[str, int]) -> dict[str, Any]:
        camera = self._rig.cell.camera
        width, height = camera.size
        # Mitsuba looks along +z with x to the left and y up
        pose = self._base_from_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])
        fov = 2 * np.degrees(np.arctan(0.5 * width / camera.K[0, 0]))
        return {
            'type': 'perspective',
            'fov': float(fov),
            'fov_axis': 'x',
            'to_world': self._mi.ScalarTransform4f(pose),
            'near_clip': 0.01,
            'far_clip': 10.0,
            # OpenCV counts pixels from the center of the first, Mitsuba from its corner
            'principal_point_offset_x': float(0.5 - (camera.K[0, 2] + 0.5) / width),
            'principal_point_offset_y': float(0.5 - (camera.K[1, 2] + 0.5) / height),
            'film': {
                'type': 'hdrfilm',
                'width': width // binned,
                'height': height // binned,
                'pixel_format': 'luminance',
                'component_format': 'float32',
                'rfilter': {'type': 'box'},
                **crop,
            },
            'sampler': {'type': 'multijitter' if crop else 'independent'},
        }

    def _projector(self, laser: int) -> dict[str, Any]:
        """Return an emitter that projects a thin line of Gaussian profile."""
        mi, rig = self._mi, self._rig
        place = transforms.apply(self._base_from_camera, rig.sources[laser].position)
        across = self._base_from_camera[:3, :3] @ rig.cell.lasers[laser].normal
        axis = np.array([0.0, 0.0, _AIM]) - place
        axis -= across * (across @ axis)
        length = float(np.linalg.norm(axis))
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 2], pose[:3, 3] = across, axis / length, place
        pose[:3, 1] = np.cross(pose[:3, 2], across)
        texels = int(2 * _SIGMAS * _TEXELS)
        profile = np.exp(-0.5 * ((np.arange(texels) + 0.5 - texels / 2) / _TEXELS) ** 2)
        line = np.tile(profile, (_LONG, 1))[..., None].astype(np.float32)
        fov = 2 * np.degrees(np.arctan(_SIGMAS * rig.sheet / length))
        return {
            'type': 'projector',
            'irradiance': {
                'type': 'bitmap',
                'bitmap': mi.Bitmap(line),
                'raw': True,
                'filter_type': 'bilinear',
                'wrap_mode': 'clamp',
            },
            'fov': float(fov),
            'fov_axis': 'x',
            'to_world': mi.ScalarTransform4f(pose),
            'scale': _POWER,
        }

    def _faces(self, angle: float) -> np.ndarray:
        """Return what each pixel sees: 0 nothing, 1 platter, 2 level faces, 3 walls."""
        camera = self._rig.cell.camera
        scene = Scene(self._solid, PLATTER, 1.0)
        rays = pixel_rays(camera).reshape(-1, 2)
        rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
        pose = part_from_camera(self._rig.cell.turntable.camera_from_base, angle)
        _, face = scene.cast(pose[:3, 3], rays @ pose[:3, :3].T)
        kind = np.where(np.abs(scene.normals[face, 2]) > 0.7, 2, 3)
        kind[face >= scene.part_faces] = 1
        kind[face < 0] = 0
        return kind.reshape(camera.height, camera.width)


def _mitsuba() -> Any:
    """
    Return Mitsuba with its variant for LLVM.

    :raises RuntimeError: Mitsuba or a libLLVM that it can use is not installed
    """
    if 'DRJIT_LIBLLVM_PATH' not in os.environ:
        # the compiler of Dr.Jit aborts the process with LLVM 14 to 16
        found = {
            int(match.group(1)): path
            for path in Path('/usr/lib').glob('*/libLLVM*')
            if (match := re.fullmatch(r'libLLVM-?(?:\.so\.)?(\d+)(?:\.so|\.\d+)?', path.name))
        }
        usable = [version for version in found if version >= _LEAST_LLVM]
        if not usable:
            raise RuntimeError(
                f'no libLLVM of version {_LEAST_LLVM} or later is installed (apt-get install '
                'libllvm19), or name it in DRJIT_LIBLLVM_PATH'
            )
        os.environ['DRJIT_LIBLLVM_PATH'] = str(found[max(usable)])
    try:
        import mitsuba
    except ImportError as error:
        raise RuntimeError('Mitsuba 3 is not installed: pip install .[bench]') from error
    mitsuba.set_variant(VARIANT)
    return mitsuba


def _blurred(light: Singles, kind: np.ndarray) -> Singles:
    """Return the light of particles without most of their noise, blurred within each kind."""
    result = np.zeros_like(light)
    for value in np.unique(kind):
        mask = (kind == value).astype(np.float32)
        weight = cv2.GaussianBlur(mask, (0, 0), _BLUR)
        smooth = cv2.GaussianBlur(light * mask, (0, 0), _BLUR) / np.maximum(weight, 1e-6)
        result += smooth * mask
    return np.maximum(result, 0.0)
