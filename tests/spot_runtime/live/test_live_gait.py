from spot_log.write.live_child import LiveGait
from spot_protos import log_pb2


def state(time_s: float) -> bytes:
    """A trot of two strides a second: a quarter of a second on each diagonal."""
    first = time_s % 0.5 < 0.25
    return log_pb2.State(foot_contact=[first, not first, not first, first]).SerializeToString()


def test_a_trot_is_named_twice_a_second_once_a_second_of_it_was_seen() -> None:
    live = LiveGait()
    told = [(0.02 * k, live.take(state(0.02 * k + 1e-6), 0.02 * k)) for k in range(150)]
    said = [(time_s, gait) for time_s, gait in told if gait is not None]
    assert [round(time_s, 2) for time_s, _ in said] == [1.0, 1.5, 2.0, 2.5]
    assert said[-1][1] == {
        "gait": "trot",
        "strides_per_s": 2.0,
        "flight": 0.0,
        "diagonals_agree": 1.0,
        "others_agree": 0.0,
    }


def test_another_run_starts_afresh_and_states_without_contacts_say_nothing() -> None:
    live = LiveGait()
    for k in range(60):
        live.take(state(0.02 * k), 0.02 * k)
    assert live.take(state(0.0), 0.0) is None
    assert live.take(log_pb2.State().SerializeToString(), 0.02) is None
