"""``spot-rl play``: what is drawn, the effects' switches, the server, and the page in a browser."""

import itertools
import re
import signal
import socket
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot.mjcf import spot_mjcf
from tests.browser import CHROMIUM, Page
from trainer.play.live_plots import SpeedHistory, live_html
from trainer.play.scene import WebServer, address_lines, check_port
from trainer.play.shapes import Bodies, shapes_of
from trainer.play.switches import BUILT_IN, Found, Switched
from trainer.play.walk import Walk
from trainer.play.web import LivePage

PAPER = load_model("paper_identified").effects


def a_walk() -> Walk:
    plant = Plant(PAPER, 1, PlantOptions(n_threads=1))
    return Walk(load_policy(policy_file("walk")), plant, np.random.default_rng(0))


def test_every_geom_of_the_robot_is_drawn_where_mujoco_has_it() -> None:
    model = mujoco.MjModel.from_xml_string(spot_mjcf())
    of_robot = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] != 0]
    qpos = model.key("default").qpos + np.random.default_rng(1).normal(0.0, 0.2, 19)
    qpos[3:7] /= np.linalg.norm(qpos[3:7])
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    positions, attitudes = Bodies(model).put(qpos)
    for geom, shape in zip(of_robot, shapes_of(model), strict=True):
        corner, drawn, there = shape.vertices_m[0].astype(float), np.empty(3), np.empty(3)
        mujoco.mju_rotVecQuat(drawn, corner, shape.body_from_geom_wxyz)
        mujoco.mju_rotVecQuat(there, drawn + shape.position_in_body_m, attitudes[shape.body])
        matrix = data.geom_xmat[geom].reshape(3, 3)
        np.testing.assert_allclose(positions[shape.body] + there, data.geom_xpos[geom] + matrix @ corner, atol=1e-6)
        half = dict(zip(("BOX", "SPHERE", "CYLINDER", "CAPSULE"), sizes(model.geom_size[geom]), strict=True))
        kind = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_")
        np.testing.assert_allclose(np.abs(shape.vertices_m).max(axis=0), half[kind], rtol=0.06)


def sizes(size: np.ndarray) -> tuple[object, ...]:
    """Half of what a box, sphere, cylinder and capsule of MuJoCo's size measure along each axis."""
    radius, half = size[:2]
    return size, [radius] * 3, [radius, radius, half], [radius, radius, radius + half]


def test_a_slider_stays_within_its_parameters_bounds_and_no_effect_is_at_one_end() -> None:
    for switch in BUILT_IN:
        p, (_, low, high, step, start) = switch.parameter, switch.slider
        assert p.low <= low < start < high <= p.high
        assert p.null in (low, high)
        assert (high - low) / step > 49
        (effect,) = switch.change(1e9)(())
        assert getattr(effect, p.name) == high
        assert switch.change(start)(()) == (switch.effect,)


def test_an_effect_stays_the_same_object_until_its_size_changes() -> None:
    switched = Switched(PAPER)
    friction, _, _, payload = BUILT_IN
    found = Found("less friction", lambda effects: effects[1:])
    assert not switched.turn(friction, None)
    assert switched.turn(friction, 2.0)
    first = switched.effects[-1]
    assert switched.turn(payload, 5.0)
    assert not switched.turn(friction, 2.0)
    assert switched.effects[:-2] == PAPER
    assert switched.effects[-2] is first
    assert switched.words == "friction in all knees, payload on the back"
    assert switched.turn(friction, 3.0)
    assert switched.effects[-2].values == {"level_nm": 3.0}
    assert switched.turn(found, 1.0)
    assert switched.effects[:-2] == PAPER[1:]
    assert all(switched.turn(switch, None) for switch in (friction, payload, found))
    assert switched.effects == PAPER


@pytest.mark.parametrize("switch", BUILT_IN, ids=lambda s: s.sized)
def test_spot_walks_on_when_an_effect_comes_and_moves_otherwise_than_without(switch) -> None:
    walk, other = a_walk(), a_walk()

    def forward(_: float) -> np.ndarray:
        return np.array([0.8, 0.0, 0.0])

    for each in (walk, other):
        for tick in itertools.islice(each.ticks(forward), 100):
            del tick
    switched = Switched(PAPER)
    switched.turn(switch, switch.slider.start)
    np.testing.assert_array_equal(walk.qpos, other.qpos)
    walk.plant.change_effects(switched.effects)
    np.testing.assert_array_equal(walk.qpos, other.qpos)
    for each in (walk, other):
        for tick in itertools.islice(each.ticks(forward), 100):
            del tick
    assert walk.falls == 0
    assert walk.qpos[0] > other.qpos[0] - 1.0
    assert np.abs(walk.qpos[7:] - other.qpos[7:]).max() > 1e-3


def test_put_back_stands_at_the_start_again() -> None:
    walk = a_walk()
    ticks = walk.ticks(lambda _: np.array([1.0, 0.0, 0.0]))
    for _ in itertools.islice(ticks, 100):
        pass
    assert walk.qpos[0] > 0.5
    walk.put_back()
    next(ticks)
    next(ticks)
    assert abs(walk.qpos[0]) < 0.05
    assert walk.falls == 0
    next(ticks)
    assert walk.time_s == pytest.approx(2.06)


def test_the_figures_beside_the_robot_are_those_of_the_walk() -> None:
    walk, history = a_walk(), SpeedHistory(seen_s=1.0)
    for _ in itertools.islice(walk.ticks(lambda _: np.array([1.0, 0.0, 0.25])), 150):
        history.note(walk)
    times, asked, measured = history.columns()
    assert times[0] == pytest.approx(-1.0, abs=0.021)
    assert times[-1] == 0.0
    assert asked.tolist() == [1.0] * len(times)
    assert measured[-1] == walk.velocity[0]
    page = live_html(walk, times, asked, measured)
    assert f"<th>forward</th><td>{walk.velocity[0]:.2f}</td><td>of 1.00 m/s</td>" in page
    assert "of 0.25 rad/s" in page
    assert walk.gait is not None
    assert f"{walk.gait.name}, {walk.gait.stride_hz:.1f} strides" in page
    assert page.count("<polyline") >= 2


def test_a_taken_port_and_a_foreign_address_are_refused_with_the_next_step() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(BadInputError, match=rf"cannot listen at 127\.0\.0\.1:{port} .*--port "):
            check_port("127.0.0.1", port)
    with pytest.raises(BadInputError, match=r"192\.0\.2\.1.*leave out --host"):
        check_port("192.0.2.1", 8080)


def test_the_printed_lines_name_the_page_and_the_tunnel_or_what_an_open_address_means() -> None:
    assert "http://localhost:8123" in address_lines("127.0.0.1", 8123)
    assert "ssh -L 8123:localhost:8123 " in address_lines("127.0.0.1", 8123)
    assert "no password" in address_lines("0.0.0.0", 8123)  # noqa: S104


def test_a_browser_that_never_comes(capsys: pytest.CaptureFixture[str]) -> None:
    server = WebServer("127.0.0.1", 0)
    try:
        assert server.request_share_url() is None
        walk = a_walk()
        page = LivePage(server, walk, PAPER, BUILT_IN, np.zeros(3))
        page.run(0.1)
    finally:
        server.stop()
    assert walk.time_s == pytest.approx(0.1)
    assert page.scene.frame_rate_hz == 0.0
    assert capsys.readouterr().out == ""


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no headless Chromium is installed")
def test_a_browser_watches_and_steers(tmp_path) -> None:
    command = [sys.executable, "-m", "spot_model", "play", "walk", "--port", "0", "--velocity", "0.5,0,0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served:
        url = re.search(r"http://\S+", served.stdout.readline())[0]
        with Page(url, tmp_path / "profile") as page:
            page.wait_for("!!document.querySelector('canvas')")
            page.wait_for("document.body.innerText.includes('of 0.50 m/s')")
            page.press("i")
            page.wait_for("document.body.innerText.includes('of 0.75 m/s')")
            page.click("Stop")
            page.wait_for("/forward\\s+-?0\\.\\d+\\s+of 0\\.00/.test(document.body.innerText)")
        with Page(url, tmp_path / "another") as page:  # one that comes back
            page.wait_for("/forward\\s+-?0\\.\\d+\\s+of 0\\.00/.test(document.body.innerText)")
        served.send_signal(signal.SIGINT)
        told = served.stdout.read()
    assert served.returncode == 0
    assert re.search(r"\d s, 0 falls; at the end .* browsers got \d+\.\d frames a second", told)


def test_neither_opengl_nor_torch_is_loaded() -> None:
    program = (
        "import sys; from compare.play_command import play; from spot_model.policy.built_in import policy_file;"
        "play(policy_file('walk'), port=0, seconds=0.1);"
        "loaded = open('/proc/self/maps').read() + ' '.join(sys.modules);"
        "print(*(word for word in ('libGL', 'libEGL', 'OSMesa', 'glfw', 'torch') if word in loaded))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""
