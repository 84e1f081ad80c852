# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of the set, rendered once into build/bench/metal, and as a sensor sees them."""

from collections.abc import Iterator
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from functools import lru_cache
import hashlib
from pathlib import Path
import sys
import time
from typing import Any
import zlib

import cv2
import numpy as np

from bench.metal import materials
from bench.metal import parts
from bench.metal.path_tracer import PathTracer
from bench.metal.path_tracer import PLATTER
from bench.metal.path_tracer import VERSION
from bench.metal.rigs import Rig
from bench.metal.rigs import RIGS
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Singles
from ivfmc_ros.simulation.render.optics import add_speckle
from ivfmc_ros.simulation.render.optics import expose
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.simulation.render.stripe_truth import StripeTruth

KEPT = Path(__file__).resolve().parents[3] / 'build' / 'bench' / 'metal'
OPTICS = Optics(stripe_sigma=1.0)  # read noise 2 DN, 45 electrons a DN, speckle 0.15, ambient 6 DN
QUIET = replace(OPTICS, speckle=0.0)
# One exposure is set so that the median row of a part's pictures peaks at this gray value.
MEDIAN_PEAK = 120.0
BRACKET = (0.2, 1.0, 5.0)  # times that exposure
_REMEMBERED = 16  # shots, of which a material has fewer


@dataclass(frozen=True, kw_only=True)
class Shot:
    """
    One picture of the set.

    angle : radians, of the table; laser : index in the rig's cell; seed : of all that is random
    """

    material: str
    part: str
    rig: str
    angle: float
    laser: int
    seed: int

    @property
    def scene(self) -> Rig:
        """The rig that takes the picture."""
        return RIGS[self.rig]

    @property
    def reflection(self) -> dict[str, Any]:
        """How Mitsuba describes the material; that of white plastic for the translucent one."""
        rendered = 'white plastic' if self.material == materials.TRANSLUCENT else self.material
        return materials.MATERIALS[rendered]

    @property
    def file(self) -> Path:
        """Where the picture is kept: named by all that it depends on."""
        rig, solid = self.scene, getattr(parts, self.part)()
        numbers = (
            solid.vertices_xyz,
            solid.faces,
            rig.cell.camera.K,
            rig.cell.turntable.camera_from_base,
            *(np.append(laser.normal, laser.offset) for laser in rig.cell.lasers),
            *(source.position for source in rig.sources),
            np.array([rig.sheet, self.angle, self.laser, self.seed]),
        )
        digest = hashlib.sha256(repr((VERSION, sorted(self.reflection.items()))).encode())
        for values in numbers:
            digest.update(np.round(values, 9).astype(np.float64).tobytes())
        return KEPT / f'{digest.hexdigest()[:24]}.npz'


@dataclass(frozen=True, eq=False, kw_only=True)
class Half:
    """A half of the set: which part in which rig, how many angles, and the first seed."""

    pairs: tuple[tuple[str, str], ...]
    angles: int
    seed: int


DEVELOPMENT = Half(pairs=(('flange', 'high'), ('channel', 'low')), angles=3, seed=100)
HELD = Half(pairs=(('gland', 'steep'), ('bracket', 'flat')), angles=2, seed=900)


def shots(half: Half, material: str) -> list[Shot]:
    """Return the pictures of a material: of each part all angles, the lasers in turn."""
    rng = np.random.default_rng([half.seed, zlib.crc32(material.encode())])
    return [
        Shot(
            material=material,
            part=part,
            rig=rig,
            angle=float(2 * np.pi * (k + rng.random()) / half.angles),
            laser=k % 2,
            seed=int(rng.integers(1 << 30)),
        )
        for part, rig in half.pairs
        for k in range(half.angles)
    ]


def turn(half: Half, material: str, angles: int) -> list[Shot]:
    """Return the pictures of a full turn of the first part, laser by laser."""
    (part, rig), *_ = half.pairs
    return [
        Shot(
            material=material,
            part=part,
            rig=rig,
            angle=float(2 * np.pi * k / angles),
            laser=laser,
            seed=half.seed + 1000 * laser + k,
        )
        for laser in (0, 1)
        for k in range(angles)
    ]


@lru_cache(maxsize=_REMEMBERED)
def truth(shot: Shot) -> StripeTruth:
    """Return where the directly lit stripe is seen, from the geometry."""
    renderer = StripeRenderer(
        cell=shot.scene.cell,
        solid=getattr(parts, shot.part)(),
        platter=PLATTER,
        sources=shot.scene.sources,
    )
    return renderer.truth(shot.angle, shot.laser)


@lru_cache(maxsize=_REMEMBERED)
def linear(shot: Shot) -> tuple[Singles, Singles]:
    """Return direct light and light that went on, (height, width) each; rendered if needed."""
    file = shot.file
    if not file.exists():
        _render(shot)
    with np.load(file) as arrays:
        direct, more = (arrays[name].astype(np.float32) for name in ('direct', 'more'))
    if shot.material == materials.TRANSLUCENT:
        return _spread(direct), _spread(more)
    return direct, more


def render_all(wanted: Sequence[Shot]) -> None:
    """Render the pictures that are not kept yet."""
    missing = [shot for shot in wanted if not shot.file.exists()]
    for number, shot in enumerate(missing):
        start = time.monotonic()
        _render(shot)
        took = time.monotonic() - start
        note = f'{number + 1} of {len(missing)}: {shot.material}, {shot.part}, {took:.0f} s'
        print(f'metal: rendered {note}', file=sys.stderr, flush=True)


def _render(shot: Shot) -> None:
    solid = getattr(parts, shot.part)()
    tracer = PathTracer(shot.scene, solid, shot.reflection)
    direct, more = tracer.light(shot.angle, shot.laser, truth(shot).uv, shot.seed)
    KEPT.mkdir(parents=True, exist_ok=True)
    part = shot.file.with_suffix('.part.npz')
    # half precision: 0.05 %, and zeros outside of the part
    np.savez_compressed(part, direct=direct.astype(np.float16), more=more.astype(np.float16))
    part.rename(shot.file)


def _spread(light: Singles) -> Singles:
    """Return the light of a translucent material: a share leaves the surface farther away."""
    reach = int(5 * materials.SPREAD_PIXELS)
    steps = np.arange(-reach, reach + 1)
    kernel = np.exp(-np.hypot(*np.meshgrid(steps, steps)) / materials.SPREAD_PIXELS)
    far = cv2.filter2D(light, -1, kernel / kernel.sum())
    return np.asarray((1 - materials.SPREAD_SHARE) * light + materials.SPREAD_SHARE * far)


def exposure(of_one_part: Sequence[Shot]) -> float:
    """Return the factor from linear light to gray values for the pictures of one part and rig."""
    peaks = [
        (direct + more)[np.unique(truth(shot).line)].max(axis=1)
        for shot in of_one_part
        for direct, more in [linear(shot)]
    ]
    return MEDIAN_PEAK / float(np.median(np.concatenate(peaks)))


def frames(shot: Shot, factor: float, exposures: Sequence[float] = (1.0,)) -> Iterator[Frame]:
    """Yield what the sensor makes of a shot at each exposure (times ``factor``)."""
    direct, more = linear(shot)
    # the speckle is that of the surface, the same in all exposures
    rng = np.random.default_rng([shot.seed, 0])
    light = add_speckle((direct + more) * np.float32(factor), OPTICS.speckle, rng)
    for k, times in enumerate(exposures):
        noise = np.random.default_rng([shot.seed, 1 + k])
        yield Frame(
            image=expose(OPTICS.ambient, light * np.float32(times), QUIET, noise),
            stamp_ns=0,
            angle=shot.angle,
            laser=shot.laser,
            view=shot.laser,
            seq=k,
        )


def by_part(wanted: Sequence[Shot]) -> list[list[Shot]]:
    """Return the shots of each part and rig."""
    groups: dict[tuple[str, str], list[Shot]] = {}
    for shot in wanted:
        groups.setdefault((shot.part, shot.rig), []).append(shot)
    return list(groups.values())
