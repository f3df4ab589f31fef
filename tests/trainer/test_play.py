import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from compare.play_command import play
from spot_model.errors import BadInputError
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import load_policy
from trainer.play.film import columns, gait_diagram
from trainer.play.start import parse_velocity
from trainer.play.walk import PUSH_M_S, Walk, following

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"


def a_walk() -> Walk:
    plant = Plant((), 1, PlantOptions(n_threads=1))
    return Walk(load_policy(POLICY), plant, np.random.default_rng(0))


def forward(_: float) -> np.ndarray:
    return np.array([1.0, 0.0, 0.0])


def test_half_a_second_without_drawing() -> None:
    walk = a_walk()
    for _ in itertools.islice(walk.ticks(forward), 25):
        pass
    assert walk.time_s == pytest.approx(0.5)
    assert walk.contact.shape == (100, 4)
    assert walk.command.tolist() == [1.0, 0.0, 0.0]
    assert walk.gait is None
    assert walk.falls == 0
    assert walk.qpos[0] > 0.0


def test_a_walk_shows_its_speed_and_gait() -> None:
    walk = a_walk()
    for _ in itertools.islice(walk.ticks(forward), 250):
        pass
    names, values = columns(walk)
    shown = dict(zip(names.splitlines(), values.splitlines(), strict=True))
    assert float(shown["forward"].split()[0]) == pytest.approx(1.0, abs=0.15)
    assert shown["gait"] == "trot"
    figure = gait_diagram(walk)
    bars = int((figure.linepnt > 0).sum())
    ground_s = sum(figure.linedata[i, 2] - figure.linedata[i, 0] for i in range(bars))
    assert ground_s == pytest.approx(walk.contact.sum() * walk.plant.timestep_s, abs=1e-4)


def test_a_newer_policy_takes_over() -> None:
    walk = a_walk()
    other = load_policy(POLICY.with_name("fast.onnx"))
    answers = iter([None] * 24 + [other])
    following = Walk(walk.policy, walk.plant, np.random.default_rng(0), lambda: next(answers, None))
    ticks = following.ticks(forward)
    for _ in itertools.islice(ticks, 25):
        pass
    assert following.policy is walk.policy
    for _ in itertools.islice(ticks, 5):
        pass
    assert following.policy is other
    assert len(following.contact) == 20


def test_a_push_adds_a_metre_a_second_and_a_fallen_robot_gets_up() -> None:
    walk = a_walk()
    ticks = walk.ticks(lambda _: np.zeros(3))
    next(ticks)
    before = walk.plant.linear_vel_of_body_in_world_m_s[0]
    walk.push()
    added = walk.plant.linear_vel_of_body_in_world_m_s[0] - before
    assert np.linalg.norm(added) == pytest.approx(PUSH_M_S)
    assert added[2] == 0.0
    walk.plant.reset(world_from_body_wxyz=(0.0, 1.0, 0.0, 0.0))  # on its back
    for _ in itertools.islice(ticks, 150):
        pass
    assert walk.falls == 1
    assert not walk.plant.body_contact[0]


def test_a_command_goes_evenly_to_what_is_wanted() -> None:
    wanted = np.zeros(3)
    velocity_at = following(lambda: wanted)
    assert velocity_at(0.0).tolist() == [0.0, 0.0, 0.0]
    wanted = np.array([0.5, 0.0, -0.25])
    # 2 m/s² for a hundredth of a second, then long enough to arrive.
    np.testing.assert_allclose(velocity_at(0.01), [0.02, 0.0, -0.02])
    for tick in range(100):
        command = velocity_at(0.02 + 0.02 * tick)
    np.testing.assert_allclose(command, [0.5, 0.0, -0.25])


@pytest.mark.parametrize(
    ("text", "message"),
    [("1,0", "not three numbers"), ("fast", "not three numbers"), ("99,0,0", "vx = 99.0"), ("0,nan,0", "vy = nan")],
)
def test_a_velocity_that_is_none_is_refused(text: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        parse_velocity(text, load_policy(POLICY).contract)


def test_a_film_of_that_name_stays(tmp_path: Path) -> None:
    film = tmp_path / "mine.mp4"
    film.write_bytes(b"mine")
    with pytest.raises(BadInputError, match="exists; nothing is overwritten"):
        play(POLICY, video=film)
    assert film.read_bytes() == b"mine"


def test_another_ending_is_refused_before_the_walk(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"ends in \.mp4 or \.gif"):
        play(POLICY, video=tmp_path / "walk.avi")


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_a_film(tmp_path: Path, ending: str) -> None:
    pytest.importorskip("imageio_ffmpeg")
    film = tmp_path / f"walk.{ending}"
    words = [str(POLICY), "--video", str(film), "--seconds", "0.1", "--velocity", "1,0,0"]
    # In a process of its own: a broken OpenGL driver may end it.
    command = [sys.executable, "-c", "from spot_model.console.command_line import main; main()", "play", *words]
    done = subprocess.run(command, capture_output=True, text=True)
    if "MuJoCo cannot draw" in done.stderr:
        pytest.skip("no OpenGL that works without a display")
    assert done.returncode == 0, done.stderr
    assert "0.1 s, 0 falls" in done.stdout
    head = film.read_bytes()[:12]
    assert head.startswith(b"GIF8") if ending == "gif" else head[4:8] == b"ftyp"
    assert [path.name for path in tmp_path.iterdir()] == [film.name]


def test_a_film_for_which_the_disk_has_no_room_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    words = [str(POLICY), "--video", str(tmp_path / "walk.mp4"), "--seconds", "0.4"]
    command = [sys.executable, "-c", "from spot_model.console.command_line import main; main()", "play", *words]
    done = subprocess.run(["sh", "-c", 'ulimit -f 4; exec "$@"', "sh", *command], capture_output=True, text=True)
    if "MuJoCo cannot draw" in done.stderr:
        pytest.skip("no OpenGL that works without a display")
    assert done.returncode == 2
    assert "walk.mp4 cannot be written" in done.stderr
    assert "is there room on the disk?" in done.stderr
    assert not list(tmp_path.iterdir())
