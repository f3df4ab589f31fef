import torch

from trainer.task.feet import FootTimers

DT = 0.02


def contacts(*flags: bool) -> torch.Tensor:
    return torch.tensor([[*flags, True, True]]) if len(flags) == 2 else torch.tensor([list(flags)])


def test_times_count_up_and_phases_are_kept_when_they_end() -> None:
    feet = FootTimers(1, "cpu")
    air, ground = contacts(False, True), contacts(True, True)
    for _ in range(3):
        assert not feet.update(air, DT).any()
    # Three periods in the air, 0.06 s; the other feet have stood as long.
    torch.testing.assert_close(feet.air_time_s, torch.tensor([[0.06, 0.0, 0.0, 0.0]]))
    torch.testing.assert_close(feet.contact_time_s, torch.tensor([[0.0, 0.06, 0.06, 0.06]]))
    touched = feet.update(ground, DT)
    assert touched.tolist() == [[True, False, False, False]]
    # The phase that ended counts the period in which it ended: 0.08 s.
    torch.testing.assert_close(feet.last_air_time_s, torch.tensor([[0.08, 0.0, 0.0, 0.0]]))
    assert feet.air_time_s[0, 0] == 0.0
    feet.update(air, DT)
    torch.testing.assert_close(feet.last_contact_time_s[0, 0], torch.tensor(0.04))


def test_duty_is_a_mean_that_forgets() -> None:
    feet = FootTimers(1, "cpu", duty_window_s=0.1)
    feet.update(contacts(True, False), DT)
    # One period of 0.02 s out of 0.1 s.
    torch.testing.assert_close(feet.duty, torch.tensor([[0.2, 0.0, 0.2, 0.2]]))
    feet.update(contacts(False, False), DT)
    torch.testing.assert_close(feet.duty, torch.tensor([[0.16, 0.0, 0.36, 0.36]]))
    feet.reset(torch.tensor([True]))
    assert not feet.duty.any()


def test_a_foot_that_stood_for_half_a_period_counts_half() -> None:
    feet = FootTimers(1, "cpu", duty_window_s=0.1)
    feet.update(contacts(True, False), DT, torch.tensor([[0.5, 0.25, 1.0, 1.0]]))
    torch.testing.assert_close(feet.duty, torch.tensor([[0.1, 0.05, 0.2, 0.2]]))


def test_reset_touches_only_the_chosen_robots() -> None:
    feet = FootTimers(2, "cpu")
    feet.update(torch.zeros(2, 4, dtype=torch.bool), DT)
    feet.reset(torch.tensor([True, False]))
    assert feet.air_time_s[0].sum() == 0.0
    torch.testing.assert_close(feet.air_time_s[1], torch.full((4,), DT))


def test_support_is_who_stands_and_in_flight_who_stood_last() -> None:
    feet = FootTimers(1, "cpu")
    feet.update(torch.tensor([[True, False, False, True]]), DT)
    feet.update(torch.tensor([[False, False, False, False]]), DT)
    assert feet.support.tolist() == [[True, False, False, True]]
    feet.update(torch.tensor([[False, True, True, False]]), DT)
    assert feet.support.tolist() == [[False, True, True, False]]
    feet.reset(torch.tensor([True]))
    assert not feet.support.any()
