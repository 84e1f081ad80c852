# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ten real range scans, displaced and brought together again: ours against Open3D's multiway."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from itertools import combinations
import os
from pathlib import Path
import time

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.table import register_jointly

ROWS, COLUMNS = 400, 512
MAX_DISTANCE = 0.012  # meters, of starts that are up to 5 mm and 5 degrees off
MAX_SAMPLES = 7_000  # samples of each scan
_FOUND = 0.0015  # meters; maximum correspondence distance of the comparison, the same for both
PRIOR = TablePrior(angle=np.radians(4), tilt=np.radians(4), offset=5e-3, height=5e-3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """A range scan and where Stanford put it, (4, 4) common_from_scan."""

    view: View
    pose: Floats


def bunny_folder() -> Path:
    data = Path(os.environ.get('IVFMC_DATA', Path(__file__).parents[2] / '..' / 'shared' / 'data'))
    return data / 'bunny'


def load_bunny(folder: Path) -> list[Scan]:
    """Read all scans that ``bun.conf`` lists."""
    scans = []
    for line in (folder / 'bun.conf').read_text().splitlines():
        words = line.split()
        if words and words[0] == 'bmesh':
            numbers = np.array(words[2:9], dtype=np.float64)
            R = Rotation.from_quat(numbers[3:]).as_matrix().T
            view = _range_grid(folder / words[1], len(scans))
            scans.append(Scan(view=view, pose=transforms.rigid(R, numbers[:3])))
    return scans


def _range_grid(path: Path, number: int) -> View:
    text = path.read_bytes()
    header, body = (part.strip() for part in text.split(b'end_header', 1))
    fields = dict(
        (line.split()[1:3] if line.startswith(b'element') else line.split()[-2:])
        for line in header.splitlines()
        if line.startswith((b'element', b'obj_info num_'))
    )
    vertices, columns = int(fields[b'vertex']), int(fields[b'num_cols'])
    lines = body.split(b'\n')
    points = np.array([line.split()[:3] for line in lines[:vertices]], dtype=np.float64)
    rows = int(fields[b'num_rows'])
    grid = np.full((rows * columns, 3), np.nan)
    for cell, line in enumerate(lines[vertices : vertices + rows * columns]):
        words = line.split()
        if words and words[0] == b'1':
            grid[cell] = points[int(words[1])]
    grid = grid.reshape(rows, columns, 3)
    sigma = np.where(np.isfinite(grid[..., 0]), 1e-4, np.nan)
    return View(
        number=number,
        laser=0,
        points_xyz=grid,
        intensity=sigma,
        sigma=sigma,
        uv=np.repeat(sigma[..., None], 2, axis=2),
        angles=np.linspace(0.0, 0.1, columns),
        seqs=np.arange(columns),
    )


def displaced(scans: Sequence[Scan], seed: int) -> list[Floats]:
    """Return starts, (4, 4) common_from_scan, up to 5 degrees and 5 mm off (the first is not)."""
    rng = np.random.default_rng((9, seed))
    starts = []
    for index, scan in enumerate(scans):
        turn, shift = rng.standard_normal((2, 3))
        turn *= np.radians(rng.uniform(0, 5)) / np.linalg.norm(turn)
        shift *= rng.uniform(0, 5e-3) / np.linalg.norm(shift)
        middle = transforms.apply(scan.pose, scan.view.cloud()).mean(axis=0)
        R = Rotation.from_rotvec(turn).as_matrix()
        error = transforms.rigid(R, middle - R @ middle + shift)
        starts.append(error @ scan.pose if index else scan.pose)
    return starts


def ours(scans: Sequence[Scan], starts: Sequence[Floats]) -> tuple[list[Floats], float]:
    """Return (4, 4) common_from_scan of each, and seconds."""
    begin = time.perf_counter()
    views = [_moved(scan.view, T) for scan, T in zip(scans, starts, strict=True)]
    poses, _ = register_jointly(views, PRIOR, MAX_DISTANCE, max_samples=MAX_SAMPLES)
    seconds = time.perf_counter() - begin
    found = [P @ T for P, T in zip(poses.turntable_from_view, starts, strict=True)]
    return found, seconds


def ours_from(seed: int) -> list[Floats]:
    """Return what is found from one displaced start."""
    scans = load_bunny(bunny_folder())
    return ours(scans, displaced(scans, seed))[0]


def _moved(view: View, T: Floats) -> View:
    return replace(view, points_xyz=transforms.apply(T, view.points_xyz))


def multiway(
    scans: Sequence[Scan], starts: Sequence[Floats], voxel: float = 1e-3
) -> tuple[list[Floats], float]:
    """
    Do as Open3D's tutorial 'Multiway registration' does, with its ratios to the voxel.

    The starts take the place of the identity from which the tutorial's scans start.
    """
    begin = time.perf_counter()
    reg = o3d.pipelines.registration
    coarse, fine = 15 * voxel, 1.5 * voxel
    clouds = []
    for scan, T in zip(scans, starts, strict=True):
        cloud = o3d.geometry.PointCloud(
            o3d.utility.Vector3dVector(transforms.apply(T, scan.view.cloud()))
        ).voxel_down_sample(voxel)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2 * voxel, max_nn=30))
        clouds.append(cloud)
    graph = reg.PoseGraph()
    graph.nodes.append(reg.PoseGraphNode(np.eye(4)))
    odometry = np.eye(4)
    estimation = reg.TransformationEstimationPointToPlane()
    for a, b in combinations(range(len(clouds)), 2):
        T = np.eye(4)
        for distance in (coarse, fine):
            T = reg.registration_icp(clouds[a], clouds[b], distance, T, estimation).transformation
        information = reg.get_information_matrix_from_point_clouds(clouds[a], clouds[b], fine, T)
        if b == a + 1:
            odometry = T @ odometry
            graph.nodes.append(reg.PoseGraphNode(np.linalg.inv(odometry)))
        graph.edges.append(reg.PoseGraphEdge(a, b, T, information, uncertain=b != a + 1))
    option = reg.GlobalOptimizationOption(
        max_correspondence_distance=fine, edge_prune_threshold=0.25, reference_node=0
    )
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        reg.global_optimization(
            graph,
            reg.GlobalOptimizationLevenbergMarquardt(),
            reg.GlobalOptimizationConvergenceCriteria(),
            option,
        )
    seconds = time.perf_counter() - begin
    return [n.pose @ T for n, T in zip(graph.nodes, starts, strict=True)], seconds


class Judge:
    """Measures the distance of overlapping scans, by all points and PCA normals, not ours."""

    def __init__(self, scans: Sequence[Scan]) -> None:
        self._points = [scan.view.cloud()[::7] for scan in scans]
        self._all = [scan.view.cloud() for scan in scans]
        self._trees = [cKDTree(points) for points in self._all]
        self._normals = [self._of(points) for points in self._all]

    @staticmethod
    def _of(points: Floats) -> Floats:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
        return np.asarray(cloud.normals)

    def rms(self, poses: Sequence[Floats]) -> float:
        """Return the rms of point-to-plane distances over all pairs of scans, trimmed 10 %."""
        off = []
        for a, b in combinations(range(len(poses)), 2):
            here = transforms.apply(transforms.invert(poses[b]) @ poses[a], self._points[a])
            distance, j = self._trees[b].query(here, distance_upper_bound=_FOUND)
            near = np.isfinite(distance)
            if near.sum() < 100:
                continue
            gap = here[near] - self._all[b][j[near]]
            off.append(np.abs((gap * self._normals[b][j[near]]).sum(axis=1)))
        every = np.sort(np.concatenate(off))
        return float(np.sqrt(np.mean(every[: int(0.9 * len(every))] ** 2)))


def apart(poses: Sequence[Floats], others: Sequence[Floats], scans: Sequence[Scan]) -> Floats:
    """Return (views, 2): degrees, and meters of the centroid, against the first scan."""
    found = []
    for scan, T, S in zip(scans, poses, others, strict=True):
        one = transforms.invert(poses[0]) @ T
        other = transforms.invert(others[0]) @ S
        turn = Rotation.from_matrix(one[:3, :3].T @ other[:3, :3]).magnitude()
        middle = scan.view.cloud().mean(axis=0)[None]
        shift = transforms.apply(one, middle) - transforms.apply(other, middle)
        found.append((np.degrees(turn), np.linalg.norm(shift)))
    return np.array(found)


def mean_poses(answers: Sequence[Sequence[Floats]], scans: Sequence[Scan]) -> list[Floats]:
    """Return the mean of several answers, (4, 4) of each scan against the first one."""
    means = []
    for index, scan in enumerate(scans):
        poses = np.array([transforms.invert(answer[0]) @ answer[index] for answer in answers])
        R = Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix()
        middle = scan.view.cloud().mean(axis=0)
        placed = np.mean([transforms.apply(T, middle) for T in poses], axis=0)
        means.append(transforms.rigid(R, placed - R @ middle))
    return means


def alike(
    answers: Sequence[Sequence[Floats]],
    scans: Sequence[Scan],
    degrees: float = 0.02,
    meters: float = 2e-5,
) -> tuple[int, str]:
    """
    Return how many results agree, and as text the largest deviation from their mean.

    Each result in turn is the reference; the smallest count is returned.
    """
    agree = []
    for one in answers:
        off = np.array([apart(other, one, scans).max(axis=0) for other in answers])
        agree.append(int(((off[:, 0] < degrees) & (off[:, 1] < meters)).sum()))
    middle = mean_poses(answers, scans)
    turn, shift = np.max([apart(one, middle, scans).max(axis=0) for one in answers], axis=0)
    return min(agree), f'{turn:.4f} degrees, {shift * 1e3:.4f} mm'
