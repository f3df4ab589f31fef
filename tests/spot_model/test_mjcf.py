"""The MuJoCo model against the published figures, its symmetry, and what its options do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from spot_model.errors import BadInputError
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, default_height_m, spot_mjcf
from spot_model.robot.terrain import QUANTUM_M, TILE_KINDS, NoiseTerrain, TileTerrain

LINK_FIGURES = {
    # link: mass kg, com m, inertia about the com (xx, yy, zz, xy, xz, yz) kg·m², front-left leg
    "body": (16.70765, (0.0, 0.0, -0.00496), (0.08154, 0.54923, 0.56945, 0.0, 0.0, 0.0)),
    "fl_hip": (
        1.13688,
        (-0.01586739, 0.00855842, 0.00000903),
        (0.00122166, 0.00158957, 0.00172903, -0.00017754, 0.0, 0.0),
    ),
    "fl_uleg": (
        2.25620,
        (0.00214442, -0.01110184, -0.07881204),
        (0.02692501, 0.02583907, 0.00318737, -0.00008782, 0.00054873, 0.00207146),
    ),
    "fl_lleg": (
        0.33,
        (0.0059736, 0.0, -0.17466427),
        (0.00701356, 0.00709946, 0.00014529, 0.0, 0.000066, 0.0),
    ),
}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(spot_mjcf())


@pytest.fixture
def data(model: mujoco.MjModel) -> mujoco.MjData:
    return mujoco.MjData(model)


def link_inertia(model: mujoco.MjModel, name: str) -> np.ndarray:
    """Inertia matrix about the com in the link's frame; MuJoCo stores principal values and a rotation."""
    body = model.body(name)
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, body.iquat)
    rotation = flat.reshape(3, 3)
    return rotation @ np.diag(body.inertia) @ rotation.T


def as_matrix(values: tuple[float, ...]) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_total_mass_is_31_60_kg(model: mujoco.MjModel) -> None:
    assert model.body_mass.sum() == pytest.approx(31.60, abs=0.001)


@pytest.mark.parametrize("name", LINK_FIGURES)
def test_link_has_the_published_mass_com_and_inertia(model: mujoco.MjModel, name: str) -> None:
    mass, com, inertia = LINK_FIGURES[name]
    assert model.body(name).mass[0] == mass
    np.testing.assert_array_equal(model.body(name).ipos, com)
    np.testing.assert_allclose(link_inertia(model, name), as_matrix(inertia), atol=1e-12)


def test_the_bodys_inertia_stays_in_the_bodys_axes(model: mujoco.MjModel) -> None:
    assert model.body("body").inertia.tolist() == [0.08154, 0.54923, 0.56945]
    assert model.body("body").iquat.tolist() == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("leg", facts.LEG_NAMES)
@pytest.mark.parametrize("link", ["hip", "uleg", "lleg"])
def test_other_legs_mirror_the_front_left_one(model: mujoco.MjModel, leg: str, link: str) -> None:
    mass, com, inertia = LINK_FIGURES[f"fl_{link}"]
    # Only the hip's housing is turned round at the hind end; both upper and lower legs bend the same way.
    mirror = np.diag([-1.0 if leg[0] == "h" and link == "hip" else 1.0, -1.0 if leg[1] == "r" else 1.0, 1.0])
    assert model.body(f"{leg}_{link}").mass[0] == mass
    np.testing.assert_allclose(model.body(f"{leg}_{link}").ipos, mirror @ np.array(com), atol=1e-15)
    expected = mirror @ as_matrix(inertia) @ mirror
    np.testing.assert_allclose(link_inertia(model, f"{leg}_{link}"), expected, atol=1e-12)


def test_joints_are_in_canonical_order_with_their_limits_and_axes(model: mujoco.MjModel) -> None:
    names = [model.joint(i).name for i in range(1, model.njnt)]
    assert " ".join(names) == "fl_hx fl_hy fl_kn fr_hx fr_hy fr_kn hl_hx hl_hy hl_kn hr_hx hr_hy hr_kn"
    limits = {"hx": (-0.785398, 0.785398), "hy": (-0.898845, 2.295108), "kn": (-2.7929, -0.2471)}
    for name in names:
        assert tuple(model.joint(name).range) == limits[name[3:]]
        assert model.joint(name).axis.tolist() == ([1, 0, 0] if name.endswith("hx") else [0, 1, 0])
    assert [model.actuator(i).name for i in range(model.nu)] == names


@pytest.mark.parametrize("leg", facts.LEG_NAMES)
def test_joint_placement(model: mujoco.MjModel, leg: str) -> None:
    end, side = (1 if leg[0] == "f" else -1), (1 if leg[1] == "l" else -1)
    np.testing.assert_array_equal(model.body(f"{leg}_hip").pos, [0.29785 * end, 0.055 * side, 0.0])
    np.testing.assert_array_equal(model.body(f"{leg}_uleg").pos, [0.0, 0.110945 * side, 0.0])
    np.testing.assert_array_equal(model.body(f"{leg}_lleg").pos, [0.025, 0.0, -0.3205])
    np.testing.assert_array_equal(model.geom(f"{leg}_foot").pos, [0.0, 0.0, -0.3365])
    assert model.geom(f"{leg}_foot").size[0] == 0.036


def test_a_mirrored_pose_has_a_mirrored_mass_matrix_and_feet(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    rng = np.random.default_rng(0)
    pose = facts.DEFAULT_POSITION_RAD + rng.uniform(-0.3, 0.3, 12)
    swap = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    sign = np.tile([-1.0, 1.0, 1.0], 4)

    def at(joint_position_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *joint_position_rad]
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        return mass, data.geom_xpos[[model.geom(f"{leg}_foot").id for leg in facts.LEG_NAMES]]

    mass, feet = (array.copy() for array in at(pose))
    mirrored_mass, mirrored_feet = at(sign * pose[swap])
    map_dofs = np.zeros((18, 18))
    map_dofs[:6, :6] = np.diag([1, -1, 1, -1, 1, -1])
    map_dofs[6 + np.arange(12), 6 + np.array(swap)] = sign
    np.testing.assert_allclose(mirrored_mass, map_dofs @ mass @ map_dofs.T, atol=1e-10)
    np.testing.assert_allclose(mirrored_feet, feet[[1, 0, 3, 2]] * [1, -1, 1], atol=1e-12)


def test_the_keyframe_puts_the_front_feet_on_the_ground(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_resetDataKeyframe(model, data, model.key("default").id)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qpos[7:], facts.DEFAULT_POSITION_RAD)
    lowest = [data.geom(f"{leg}_foot").xpos[2] - 0.036 for leg in facts.LEG_NAMES]
    np.testing.assert_allclose(lowest[:2], 0.0, atol=1e-12)
    assert 0.01 < lowest[2] < 0.03
    assert default_height_m() == pytest.approx(0.519, abs=0.001)


def test_the_default_pose_sags_a_third_of_a_radian_at_the_knees_under_the_policy_gains(
    model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(600):
        data.ctrl[:] = 60.0 * (facts.DEFAULT_POSITION_RAD - data.qpos[7:]) - 1.5 * data.qvel[6:]
        mujoco.mj_step(model, data)
    sag = facts.DEFAULT_POSITION_RAD - data.qpos[7:]
    assert np.all((sag[2::3] > 0.29) & (sag[2::3] < 0.36))
    assert 0.38 < data.qpos[2] < 0.46
    assert data.ncon == 4
    # The feet carry the weight: the sensors hold (found, fx, fy, fz) for the force of the foot on the ground.
    feet = data.sensordata[:16].reshape(4, 4)
    assert feet[:, 0].tolist() == [1, 1, 1, 1]
    assert -feet[:, 3].sum() == pytest.approx(31.60 * 9.81, rel=0.01)


def test_nominal_joints_have_no_armature_damping_or_friction(model: mujoco.MjModel) -> None:
    assert not model.dof_armature.any()
    assert not model.dof_damping.any()
    assert not model.dof_frictionloss.any()


def test_options_reach_the_model() -> None:
    armature = tuple(0.01 * (i + 1) for i in range(12))
    model = mujoco.MjModel.from_xml_string(
        spot_mjcf(
            MjcfOptions(
                timestep_s=0.001,
                integrator="implicitfast",
                cone="elliptic",
                solver_iterations=7,
                contact_solref=(0.004, 0.9),
                contact_solimp=(0.8, 0.99, 0.002),
                foot_friction=0.37,
                armature_kg_m2=armature,
                link_torque_sensors=True,
            )
        )
    )
    assert model.opt.timestep == 0.001
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.iterations == 7
    foot = model.geom("hr_foot")
    assert foot.solref.tolist() == [0.004, 0.9]
    assert foot.solimp[:3].tolist() == [0.8, 0.99, 0.002]
    assert foot.friction[0] == 0.37
    assert model.dof_armature[6:].tolist() == list(armature)
    assert model.nsensordata == 16 + 36


@pytest.mark.parametrize(("collision", "touching"), [("feet", 0), ("all", 4)])
def test_a_body_dropped_on_its_belly_touches_only_where_collision_says_so(collision: str, touching: int) -> None:
    model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(collision=collision)))  # type: ignore[arg-type]
    data = mujoco.MjData(model)
    data.qpos[2] = 0.08  # the box's half height is 0.085 m; the legs are folded up
    data.qpos[7:] = np.tile([0.0, 2.2, -0.3], 4)
    mujoco.mj_forward(model, data)
    on_body = sum(1 for i in range(data.ncon) if model.geom("body").id in data.contact[i].geom)
    assert on_body == touching


def test_rough_ground_is_seeded_bounded_and_level_at_the_start() -> None:
    terrain = NoiseTerrain(seed=3, amplitude_m=0.05, half_size_m=3.0)
    heights = terrain.heights_m()
    np.testing.assert_array_equal(heights, terrain.heights_m())
    assert not np.array_equal(heights, NoiseTerrain(seed=4, amplitude_m=0.05, half_size_m=3.0).heights_m())
    assert heights.shape == (25, 25)
    assert 0.04 < np.abs(heights).max() <= 0.05
    assert heights[12, 12] == 0.0


def test_rough_ground_that_goes_on_has_no_edge_to_fall_off() -> None:
    """Along a line across the edge there is ground everywhere, without a step higher than the ground's own."""
    terrain = NoiseTerrain(seed=3, amplitude_m=0.05, half_size_m=3.0, goes_on=True)
    model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(terrain=terrain)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    down, geom_id = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    starts = [np.array([x, 0.01, 1.0]) for x in np.arange(2.0, 6.0, 0.05)]
    heights = [1.0 - mujoco.mj_ray(model, data, start, down, None, True, -1, geom_id) for start in starts]
    assert np.abs(np.diff(heights)).max() < 1.5 * 0.05 * (2 * 0.05 / 0.25)  # the steepest cell rises by two amplitudes
    assert np.ptp(heights[-40:]) == 0.0
    inner = NoiseTerrain(seed=3, amplitude_m=0.05, half_size_m=3.0).heights_m()
    np.testing.assert_array_equal(terrain.heights_m()[1:-1, 1:-1], inner[1:-1, 1:-1])


def test_rough_ground_lies_where_its_heights_say() -> None:
    terrain = NoiseTerrain(seed=3, amplitude_m=0.05, half_size_m=3.0)
    model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(terrain=terrain)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    heights = terrain.heights_m()
    geom_id = np.zeros(1, np.int32)
    for row, column in [(1, 20), (20, 1), (23, 23), (5, 2)]:
        # A little off the grid point, where the ray would fall between two triangles.
        start = np.array([-3.0 + 0.25 * column + 1e-6, -3.0 + 0.25 * row + 2e-6, 1.0])
        distance = mujoco.mj_ray(model, data, start, np.array([0.0, 0.0, -1.0]), None, True, -1, geom_id)
        assert 1.0 - distance == pytest.approx(heights[row, column], abs=1e-5)


def test_tiles_fit_together_and_keep_to_their_bounds() -> None:
    terrain = TileTerrain(seed=1, half_size_m=12.0, tile_m=6.0, slope_deg=10.0, step_m=0.05, amplitude_m=0.03)
    heights = terrain.heights_m()
    assert heights.shape == (481, 481)
    np.testing.assert_array_equal(heights, terrain.heights_m())
    assert not np.array_equal(heights, TileTerrain(seed=2, half_size_m=12.0, tile_m=6.0).heights_m())
    assert not heights[::120].any()
    assert not heights[:, ::120].any()
    tiles = {kind: [] for kind in TILE_KINDS}
    for number, kind in enumerate(terrain.kinds()):
        row, column = divmod(number, 4)
        tiles[kind].append(heights[120 * row : 120 * row + 121, 120 * column : 120 * column + 121])
    assert all(len(found) == 2 * TILE_KINDS.count(kind) for kind, found in tiles.items())
    most = 0.05 * np.tan(np.radians(10.0)) + QUANTUM_M
    for tile in tiles["slope up"] + [-tile for tile in tiles["slope down"]]:
        assert 0.3 * most < np.abs(np.diff(tile, axis=1)).max() <= most
        assert tile.min() == 0.0
        assert tile[60, 60] == tile.max() > 0.2
    for tile in tiles["stairs up"] + [-tile for tile in tiles["stairs down"]]:
        rises = np.abs(np.diff(tile, axis=1))
        assert 0.02 < rises.max() <= 0.05 + QUANTUM_M
        assert (rises < 1e-9).mean() > 0.8
    for tile in tiles["rough"]:
        assert 0.01 < np.abs(tile).max() <= 0.03 + QUANTUM_M
    for tile in tiles["blocks"]:
        assert tile.min() == 0.0
        assert 0.04 < tile.max() <= 0.05 + QUANTUM_M
    assert not np.any(tiles["level"])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"slope_deg": 0.0}, "slope_deg is 0.0; it must be above 0 and at most 30"),
        ({"tile_m": 30.0, "half_size_m": 10.0}, "tile_m is 30.0 m; it must be at most twice half_size_m"),
        ({"cell_m": 0.0}, "cell_m is 0.0; it must be above 0 m"),
    ],
)
def test_tiles_out_of_bounds_are_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        TileTerrain(seed=0, **wrong)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"timestep_s": 0.0}, r"MjcfOptions.timestep_s is 0.0; it must be above 0 s"),
        ({"integrator": "leapfrog"}, r"integrator is 'leapfrog'; it must be one of Euler, implicitfast"),
        ({"armature_kg_m2": (0.1, 0.2)}, r"armature_kg_m2 is \(0.1, 0.2\); it must be one number or twelve"),
        ({"armature_kg_m2": -0.1}, r"at least 0 kg·m²"),
        ({"collision": "knees"}, r"one of feet, all"),
    ],
)
def test_a_wrong_option_is_refused_with_what_is_allowed(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        MjcfOptions(**wrong)  # type: ignore[arg-type]


def test_without_visuals_a_fall_is_the_same_bit_for_bit() -> None:
    falls = []
    for visuals in (True, False):
        model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(visuals=visuals)))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qvel[:3] = (1.0, 0.5, 0.0)
        mujoco.mj_step(model, data, 300)
        falls.append((model.ngeom, data.qpos.copy(), data.ncon))
    (many, seen, touching), (few, unseen, also_touching) = falls
    assert few < many
    assert np.array_equal(seen, unseen)
    assert touching == also_touching > 4
