# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.cylinder_scan import stated_cell

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.alignment import align
from ivfmc_ros.inspection.alignment import align_datums
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.inspection.mesh_file import require_closed
from ivfmc_ros.inspection.mesh_file import require_similar_size
from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.verdict import judge
from ivfmc_ros.inspection.verdict import judge_surface
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import sphere
from ivfmc_ros.simulation.parts.solids import stepped_shaft
from ivfmc_ros.surface import Surface

SHAFT = stepped_shaft([(0.02, 0.015), (0.01, 0.02)])
BOX = box((0.02, 0.03, 0.05))


# Standard uncertainty of the vertices of a mesh that is exact, meters.
SURE = 1e-6


def body(solid, closed=True):
    return MeshBody(vertices_xyz=solid.vertices_xyz, faces=solid.faces, closed=closed)


def settings_of(tolerance=0.1e-3, **others):
    return InspectSettings(tolerance=tolerance, vertex_u=SURE, **others)


def scanned(mesh, sigma=SURE, systematic=0.0):
    """The mesh as a scan states it: with the noise and the systematic error of each vertex."""
    count = len(mesh.vertices_xyz)
    return replace(mesh, sigma=np.full(count, sigma), systematic=np.full(count, systematic))


def exact_cell():
    """A cell whose covariances are a thousandth of those of a typical calibration."""
    cell = stated_cell()
    axis = replace(cell.turntable, covariance=1e-6 * cell.turntable.covariance)
    lasers = tuple(replace(laser, covariance=1e-6 * laser.covariance) for laser in cell.lasers)
    return replace(cell, turntable=axis, lasers=lasers)


def fine_box():
    """A box of many small triangles, as a scan has them."""
    return subdivided(BOX, 5)


def subdivided(solid, rounds):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(solid.vertices_xyz), o3d.utility.Vector3iVector(solid.faces)
    ).subdivide_midpoint(rounds)
    return MeshBody(
        vertices_xyz=np.asarray(mesh.vertices), faces=np.asarray(mesh.triangles), closed=True
    )


def moved(mesh, T):
    return replace(mesh, vertices_xyz=transforms.apply(T, mesh.vertices_xyz))


def test_perfect_part_passes_and_one_that_is_too_large_fails():
    nominal = body(BOX)
    good = inspect(fine_box(), nominal, settings_of(0.05e-3))
    assert good.whole.verdict == 'pass'
    assert good.whole.deviation.worst < 1e-6
    large = replace(fine_box(), vertices_xyz=fine_box().vertices_xyz * 1.02)
    bad = inspect(large, nominal, settings_of(0.05e-3))
    assert bad.whole.verdict == 'fail'
    assert bad.whole.deviation.mean > 0.1e-3
    said = document(bad, InspectSettings())
    assert said['verdict'] == 'fail'
    assert 0 < said['surface'][0]['vertices'] < len(bad.vertices_xyz)


def test_doubtful_scale_of_the_cell_decides_with_the_verdict_and_is_said():
    mesh, nominal = scanned(fine_box()), body(BOX)
    cell = exact_cell()
    doubted = replace(cell, notes={'board': {'scale_doubt': 0.005}})
    right, unsure = (
        inspect(mesh, nominal, InspectSettings(tolerance=0.1e-3).with_scale_of(one), one)
        for one in (cell, doubted)
    )
    assert right.whole.verdict == 'pass'
    assert unsure.whole.verdict != 'pass'
    assert any('0.50 mm in 100 mm' in note for note in unsure.notes)
    assert not any('in 100 mm' in note for note in right.notes)


def test_dent_shows_in_its_region_only():
    dented = fine_box()
    vertices = dented.vertices_xyz.copy()
    top = vertices[:, 2] > 0.0499
    near = np.hypot(vertices[:, 0], vertices[:, 1]) < 0.004
    vertices[top & near, 2] -= 0.2e-3
    found = inspect(replace(dented, vertices_xyz=vertices), body(BOX), settings_of(align='none'))
    verdicts = [judged.verdict for judged in found.regions]
    assert sorted(verdicts) == ['fail', *['pass'] * 5]
    assert found.whole.deviation.worst == pytest.approx(0.2e-3, rel=0.01)
    # into the part is negative
    assert found.deviations.min() == pytest.approx(-0.2e-3, rel=0.01)


def test_uncertain_calibration_leaves_it_undecided():
    off = replace(fine_box(), vertices_xyz=fine_box().vertices_xyz * 1.0006)
    sure = inspect(off, body(BOX), settings_of(0.03e-3))
    assert sure.calibrated
    unsure = inspect(scanned(off), body(BOX), InspectSettings(tolerance=0.03e-3), stated_cell())
    assert unsure.calibrated
    assert unsure.whole.budget.standard > 0.005e-3
    assert unsure.whole.budget.components['calibration'] > 0.9 * unsure.whole.budget.standard
    assert sure.whole.verdict == 'pass'
    assert unsure.whole.verdict == 'not measured well enough'
    # with a tolerance that the calibration allows, the same mesh is judged
    wide = InspectSettings(tolerance=0.5e-3)
    assert inspect(scanned(off), body(BOX), wide, stated_cell()).whole.verdict == 'pass'


@pytest.mark.parametrize('part', ['sigma', 'systematic', 'cell'])
def test_without_a_known_uncertainty_there_is_no_verdict(part):
    """A right part is not passed, and a wrong one not failed, by an unknown uncertainty."""
    mesh, cell = scanned(fine_box()), stated_cell()
    mesh = replace(mesh, **{part: None}) if part != 'cell' else mesh
    wrong = replace(mesh, vertices_xyz=mesh.vertices_xyz * 1.02)
    for each in (mesh, wrong):
        found = inspect(each, body(BOX), InspectSettings(), None if part == 'cell' else cell)
        assert found.whole.verdict == 'no uncertainty known'
        verdicts = {item.verdict for f in found.features for item in f.characteristics}
        # narrow faces have too few patches for a flatness
        assert verdicts - {'not measured well enough'} == {'no uncertainty known'}
        assert document(found, InspectSettings())['verdict'] == 'no uncertainty known'
        assert 'no verdict' in found.notes[0]
    assert np.isnan(found.uncertainty).all()


def test_vertices_that_an_edge_may_displace_do_not_decide():
    """Half of the top face is far off, and known to be uncertain: it fails nothing."""
    mesh = scanned(fine_box())
    off = (mesh.vertices_xyz[:, 2] > 0.0499) & (mesh.vertices_xyz[:, 0] > 0.0)
    vertices = mesh.vertices_xyz + 0.3e-3 * off[:, None] * (0.0, 0.0, 1.0)
    blind = replace(mesh, vertices_xyz=vertices)
    settings = InspectSettings(align='none')
    assert inspect(blind, body(BOX), settings, exact_cell()).whole.verdict == 'fail'
    known = replace(blind, systematic=np.where(off, 0.2e-3, 0.0))
    found = inspect(known, body(BOX), settings, exact_cell())
    top = max(found.regions, key=lambda region: -region.coverage)
    assert found.whole.verdict == 'pass'
    assert 0.3 < top.coverage < 0.55
    assert document(found, settings)['verdict'] == 'pass'


def test_features_of_a_shaft_are_found_and_sized():
    fine = subdivided(SHAFT, 3)
    found = inspect(fine, body(SHAFT), settings_of(align='none'))
    round_ = [f for f in found.features if f.nominal.kind == 'cylinder']
    assert sorted(f.feature.diameter for f in round_) == pytest.approx([0.02, 0.04], abs=3e-6)
    for f in round_:
        names = [item.name for item in f.characteristics]
        assert names[:3] == ['diameter', 'position', 'cylindricity']
        assert set(names[3:]) <= {'roundness', 'straightness'}
        assert f.verdict == 'pass'
        assert np.abs(f.feature.axis @ [0.0, 0.0, 1.0]) == pytest.approx(1.0, abs=1e-6)
        assert f.feature.center_xyz[:2] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_feature_has_its_own_tolerance():
    fine = subdivided(SHAFT, 3)
    large = replace(fine, vertices_xyz=fine.vertices_xyz * (1.002, 1.002, 1.0))
    names = {r.name: r.shape.diameter for r in segment_surface(SHAFT.vertices_xyz, SHAFT.faces)}
    thin = next(name for name, diameter in names.items() if diameter == pytest.approx(0.02))
    for tolerance, verdict in ((0.02e-3, 'fail'), (0.1e-3, 'pass')):
        settings = settings_of(features={thin: {'diameter': tolerance}}, align='none')
        found = inspect(large, body(SHAFT), settings)
        own = next(f for f in found.features if f.name == thin)
        assert own.characteristics[0].verdict == verdict
        assert own.characteristics[0].deviation == pytest.approx(0.04e-3, abs=4e-6)
    with pytest.raises(ParameterError, match="no feature 'cylinder 9'; did you mean 'cylinder "):
        inspect(large, body(SHAFT), settings_of(features={'cylinder 9': {'diameter': 1e-4}}))


def test_faces_of_a_box_and_a_shaft_are_told_apart():
    assert [region.name for region in segment_surface(BOX.vertices_xyz, BOX.faces)] == [
        f'plane {k}' for k in range(1, 7)
    ]
    shapes = [region.shape.kind for region in segment_surface(SHAFT.vertices_xyz, SHAFT.faces)]
    assert sorted(shapes) == ['cylinder', 'cylinder', 'plane', 'plane', 'plane']


def test_coarse_facets_of_the_nominal_are_an_uncertainty_of_its_diameter():
    """A polygon of 32 sides through a circle of 20 mm lies 0.032 mm inside of it in the mean."""
    import trimesh

    coarse = trimesh.creation.cylinder(radius=0.01, height=0.03, sections=32)
    region = next(
        r
        for r in segment_surface(coarse.vertices, np.asarray(coarse.faces))
        if r.shape.kind == 'cylinder'
    )
    sagitta = 0.01 * (1 - np.cos(np.pi / 32))
    assert region.facet_depth == pytest.approx(2 / 3 * sagitta, rel=0.01)
    solid = Solid(vertices_xyz=np.asarray(coarse.vertices), faces=np.asarray(coarse.faces))
    found = inspect(subdivided(solid, 4), body(solid), settings_of(align='none'))
    item = next(f for f in found.features if f.nominal.kind == 'cylinder').characteristics[0]
    assert abs(item.deviation) == pytest.approx(4 / 3 * sagitta, rel=0.05)
    assert abs(item.deviation) < item.budget.expanded


def test_chamfer_is_no_sphere():
    import trimesh

    profile = [[0, 0], [0.02, 0], [0.02, 0.01], [0.019, 0.011], [0, 0.011]]
    turned = trimesh.creation.revolve(np.array(profile), sections=256)
    names = [r.name for r in segment_surface(turned.vertices, np.asarray(turned.faces))]
    assert sorted(names) == ['cylinder 1', 'free form 1', 'plane 1', 'plane 2']
    ball = sphere(0.02)
    assert [r.name for r in segment_surface(ball.vertices_xyz, ball.faces)] == ['sphere 1']


def test_what_closes_a_mesh_is_not_judged():
    mesh = fine_box()
    bottom = mesh.vertices_xyz[:, 2] < 1e-6
    # as the floor of a scan, which is cut off above the platter
    vertices = mesh.vertices_xyz + bottom[:, None] * (0.0, 0.0, 0.5e-3)
    closing = replace(mesh, vertices_xyz=vertices, sigma=np.where(bottom, np.nan, 1e-6))
    found = inspect(closing, body(BOX), settings_of())
    assert found.whole.verdict == 'pass'
    assert len(found.unseen) == 1 and len(found.regions) == 5
    assert np.isnan(found.deviations[: len(bottom)][bottom]).all()
    assert document(found, settings_of())['unseen'] == found.unseen
    # a file without sigma does not say what was measured
    bare = inspect(replace(closing, sigma=None), body(BOX), settings_of())
    assert bare.whole.verdict == 'fail'
    unknown = replace(closing, sigma=np.full(len(vertices), np.nan))
    assert inspect(unknown, body(BOX), settings_of()).whole.verdict == 'fail'


@pytest.mark.parametrize('seed', range(3))
def test_global_alignment_finds_the_pose_from_anywhere(seed):
    rng = np.random.default_rng(seed)
    shift = transforms.rigid(Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))
    mesh = moved(fine_box(), shift)
    surface = Surface(BOX.vertices_xyz, BOX.faces)
    found = align(mesh.vertices_xyz, surface, fine_box().vertices_xyz, 'global')
    assert found.rms < 1e-6


def test_datum_points_give_the_pose():
    points = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.02, 0], [0, 0, 0.05]])
    T = transforms.rigid(Rotation.from_rotvec([0.1, -0.4, 0.2]).as_matrix(), (0.01, 0.02, 0.03))
    found = align_datums(points, transforms.apply(T, points))
    assert found.nominal_from_mesh == pytest.approx(T, abs=1e-12)
    with pytest.raises(GeometryError, match='datum: the points are collinear'):
        align_datums(np.outer(np.arange(4.0), [1, 1, 0]), np.outer(np.arange(4.0), [1, 0, 0]))
    with pytest.raises(GeometryError, match='three or more points'):
        align_datums(points[:2], points[:2])


@pytest.mark.parametrize(('wrong', 'right'), [('m', 'mm'), ('inch', 'mm'), ('mm', 'inch')])
def test_unit_that_is_wrong_is_suspected_and_named(tmp_path, wrong, right):
    write_solid(tmp_path / 'nominal.stl', BOX.vertices_xyz, BOX.faces, right)
    nominal = read_mesh(tmp_path / 'nominal.stl', wrong)
    paths = tmp_path / 'mesh.ply', tmp_path / 'nominal.stl'
    advice = f'the sizes would agree with --nominal-unit {right}, the unit of nominal.stl$'
    with pytest.raises(GeometryError, match=advice):
        require_similar_size(fine_box(), nominal, paths, ('mm', wrong))
    again = read_mesh(tmp_path / 'nominal.stl', right)
    require_similar_size(fine_box(), again, paths, ('mm', right))
    assert again.closed


@pytest.mark.parametrize(('wrong', 'right'), [('m', 'mm'), ('inch', 'mm')])
def test_wrong_unit_of_the_mesh_is_not_blamed_on_the_nominal(tmp_path, wrong, right):
    """A mesh in mm that was read in meters is 60 m across: the nominal is not."""
    write_solid(tmp_path / 'mesh.stl', BOX.vertices_xyz, BOX.faces, right)
    paths = tmp_path / 'mesh.stl', tmp_path / 'nominal.stl'
    measured = read_mesh(paths[0], wrong)
    with pytest.raises(GeometryError, match=f'agree with --unit {right}, the unit of mesh.stl'):
        require_similar_size(measured, fine_box(), paths, (wrong, 'mm'))


def test_size_that_no_unit_explains_is_said_so(tmp_path):
    large = replace(fine_box(), vertices_xyz=fine_box().vertices_xyz * 5)
    with pytest.raises(GeometryError, match='the sizes agree in no unit'):
        require_similar_size(
            large, body(BOX), (tmp_path / 'y.ply', tmp_path / 'x.stl'), ('mm', 'mm')
        )


def test_nominal_with_a_hole_is_refused(tmp_path):
    write_solid(tmp_path / 'open.stl', BOX.vertices_xyz, BOX.faces[1:])
    nominal = read_mesh(tmp_path / 'open.stl', 'mm')
    assert not nominal.closed
    with pytest.raises(GeometryError, match=r'open\.stl: the mesh is not closed'):
        require_closed(nominal, tmp_path / 'open.stl')


def test_files_that_are_no_meshes_are_refused(tmp_path):
    (tmp_path / 'text.stl').write_text('nothing')
    with pytest.raises(FileError, match=r'text\.stl: has no triangles'):
        read_mesh(tmp_path / 'text.stl', 'mm')
    with pytest.raises(FileError, match='file not found'):
        read_mesh(tmp_path / 'none.stl', 'mm')
    with pytest.raises(FileError, match=r"'\.step' is not a supported mesh format"):
        read_mesh(tmp_path / 'part.step', 'mm')
    with pytest.raises(ParameterError, match="unit: 'cm' is not one of"):
        read_mesh(tmp_path / 'text.stl', 'cm')


@pytest.mark.parametrize(
    ('deviation', 'u', 'verdict'),
    [
        (0.05, 0.01, 'pass'),
        (-0.05, 0.01, 'pass'),
        (0.09, 0.01, 'not decided'),
        (0.11, 0.01, 'not decided'),
        (-0.12, 0.01, 'fail'),
        (0.0, 0.1, 'not decided'),
        (np.nan, 0.01, 'not measured well enough'),
        (0.05, np.nan, 'no uncertainty known'),
        (9.0, np.nan, 'no uncertainty known'),
    ],
)
def test_guard_band_decides(deviation, u, verdict):
    assert judge(deviation * 1e-3, u * 1e-3, 0.1e-3) == verdict


def test_single_stray_vertex_fails_no_surface():
    deviations = np.zeros(5000)
    deviations[7] = 1e-3
    assert judge_surface(deviations, np.zeros(5000), 0.1e-3) == 'pass'
    deviations[:10] = 1e-3
    assert judge_surface(deviations, np.zeros(5000), 0.1e-3) == 'fail'


def test_stray_fails_no_small_face_either():
    """0.1 % of 200 vertices is less than one."""
    deviations = np.zeros(200)
    deviations[7] = 1e-3
    assert judge_surface(deviations, np.zeros(200), 0.1e-3) == 'fail'
    assert judge_surface(deviations, np.zeros(200), 0.1e-3, strays=3) == 'pass'
    deviations[:4] = 1e-3
    assert judge_surface(deviations, np.zeros(200), 0.1e-3, strays=3) == 'fail'


@pytest.mark.parametrize('tolerance', [0.0, -1e-3, np.nan, 2.0])
def test_tolerance_out_of_range_is_refused(tolerance):
    with pytest.raises(ParameterError, match=r'^tolerance: '):
        InspectSettings(tolerance=tolerance)
