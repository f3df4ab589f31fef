"""One page of each kind, made from little."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from compare.differences import differences
from compare.page import comparison_page
from diagnosis.document import Number, Verdict
from diagnosis.improve.improvement import Improvement, TakenStep
from diagnosis.improve.judgement import compared_figures
from diagnosis.improve.limits import Limit
from diagnosis.improve.page import improvement_page
from diagnosis.report.drift import drift_of
from diagnosis.report.history import Dated
from diagnosis.report.history_page import history_page
from diagnosis.report.page import page as diagnosis_page
from spot_log.page.page import page_html
from spot_model.io.model_file import RobotModel
from tests.compare.tracks import a_track
from tests.diagnosis.report_case import a_diagnosis, calibration, consequences, runs, verdict
from tests.withheld.scoring.made_up import fault, outcome, said
from trainer.evaluate.holds import CONDITIONS
from trainer.evaluate.page import evaluation_page
from trainer.sysid.page import identification_page
from trainer.sysid.result import ResultData
from withheld.scoring.page import page as scores_page

LONG: Final = "a_command_sequence_with_a_name_that_is_rather_long"


def _gait(share: float) -> dict[str, Any]:
    feet = {"duty_factors": [share, share, share + 0.02, share], "phases": [0.0, 0.5, 0.5, 0.0]}
    return {"gait": "trot", "stride_hz": 1.8, "flight_share": 0.0, "power_w": 40.0 + 100.0 * share, **feet}


def evaluation(falls: int = 2, top_m_s: float = 1.6) -> dict[str, Any]:
    """Figures of an evaluation, as in ``evaluation.json``."""
    points = []
    for axis, values in enumerate(((-0.5, 0.0, 0.5, 1.0, 1.5), (-0.5, 0.5), (-1.0, 1.0))):
        for value in values:
            command = [value if i == axis else 0.0 for i in range(3)]
            error = [0.01 + 0.02 * abs(value)] * 3
            points.append({"command": command, "velocity": command, "error": error, "fell": False, **_gait(0.5)})
    trial = {"trials": 2, "survived": 1, "v_x_m_s": 1.0, "fell": [{"why": "at 3.2 s: fl touched down too late"}]}
    held = [{"group": c.group, "name": c.name, "robots": 4, "held": 3, "stayed_up": 4} for c in CONDITIONS]
    return {
        "policy": "walk",
        "physics": {"timestep_s": 0.005, "integrator": "Euler"},
        "seed": 0,
        "tracking": {
            "points": points, "mean_forward_error_m_s": 0.03, "mean_lateral_error_m_s": 0.02, "fell": [],
            "mean_yaw_error_rad_s": 0.02, "standing_speed_m_s": 0.0, "peak_torque_nm": 60.1, "worst_duty_spread": 0.02,
        },
        "top_speed": {
            "sustained_m_s": top_m_s, "curve": [[0.5, 0.5, True], [1.0, 0.99, True], [1.6, 1.5, True]],
            "duty_spread": 0.02, "fell": [], **_gait(0.4),
        },
        "episodes_slow": {"episodes": 2, "falls": falls, "robot_s": 41.8, "v_x_m_s": [0.0, 1.7], "fell": []},
        "pushes": trial,
        "slippery_patch": trial,
        "holds": {
            "seconds": 15.0, "speed_m_s": [0.3, 1.0], "progress_needed": 0.7,
            "conditions": [{**c, "progress": 0.95} for c in held],
        },
    }  # fmt: skip


def _history() -> str:
    dated = []
    for day, gain in ((1, 1.0), (8, 0.9), (15, 0.8)):
        numbers = [n.model_copy(update={"value": n.value * gain}) for n in calibration().numbers]
        own = calibration().model_copy(update={"numbers": tuple(numbers)})
        told = verdict((), calibration=own, robot="spot-A", since="2026-11-01" if day > 1 else "")
        dated.append(Dated(Path(f"2026-11-{day:02d}"), told, RobotModel()))
    return history_page(drift_of(dated))


def _improvement() -> str:
    old, new = evaluation(), evaluation(falls=0, top_m_s=1.7)
    limit = Limit("torque_max_nm", "N·m", 115.0, 99.0, 95.0, 103.0, is_known=True, is_reached=True)
    steps = (TakenStep("diagnose the logs", f"spot-rl diagnose {LONG}/logs --out {LONG}/diagnosis", 61.0),)
    result = Improvement("improved", "walk", (limit,), compared_figures(old, new), steps, ("A note.",), {})
    return improvement_page(result, verdict(()), [old, new])


def _comparison() -> str:
    tracks = [a_track(), a_track("corrected model", offset_rad=0.005), a_track("nominal model", offset_rad=0.05)]
    for i, track in enumerate(tracks):
        track.foot_contact[i * 20 :: 100] = True
    return comparison_page(tracks, [differences(tracks[0], t) for t in tracks[1:]], [], "", ["A note."])


def _identification() -> str:
    number = {"value": 99.4, "low": 20.0, "high": 160.0}
    one = {
        "name": "torque_speed_curve[knees].torque_max_nm", "unit": "N·m", "initial": 70.0, **number, "reason": "",
        "identified": True, "source": "measured torque", "by_search": number, "by_torque": number,
    }  # fmt: skip
    reason = "only together with intersect_min_rad_s: 170 samples that depend on both allow many pairs"
    other = {**one, "identified": False, "source": "not identified", "reason": reason}
    data: dict[str, Any] = {
        "policy_sha256": "0" * 64, "logs": [f"{LONG}-1.mcap"], "confidence": 0.9, "parameters": [one, other],
        "measured": [], "score": {"initial": 2.9, "search": 2.2, "identified": 1.1}, "score_is_over_floor": True,
        "score_by_generation": [2.2, 2.0, None, 1.2], "command_delay_median_s": 0.003, "path_delay_median_s": 0.005,
        "observation_noise_sigma": [0.01] * 48, "load_noise_nm": [0.4] * 12, "torque_residual_nm": 0.6,
        "time_offset_s": 0.001, "warnings": [], "config": {},
        "sequences": [{"name": "forward", "repeats": 2, "floor_w1_nm": 0.2, "floor_mmd": 0.1, "mmd_bandwidth_nm": 9.0}],
    }  # fmt: skip
    time_s = np.linspace(0.0, 6.0, 150)[:, None] + np.arange(12)
    traces = [(np.sin(time_s + shift), 20.0 * np.cos(time_s + shift)) for shift in (0.0, 0.3, 0.1)]
    return identification_page(ResultData.model_validate(data), [("forward", slice(0, 150), 50.0, traces)])


def _scores() -> str:
    o = outcome([fault("coulomb_friction", coulomb_friction__level_nm=2.0)], [said("coulomb_friction")])
    share = {"value": 0.57, "hits": 12, "trials": 21, "low": 0.37, "high": 0.76}
    row = {"title": "single faults named", "text": "0.57 (21; 0.37 to 0.76)", "asked": "≥ 0.9", "met": "not met"}
    data = {
        "cases": 1, "asked_cases": 1, "reality": "withheld.realities.own:Own", "seed": 5, "is_seed_drawn": True,
        "core_seconds_a_case": {"mean": 60.0}, "revision": "0" * 40, "digest": "0" * 64,
        "table": [{**row, "trials": 21}, {**row, "trials": 0, "met": ""}],
        "breakdown": {"kind": {"one effect of the library": share}},
    }  # fmt: skip
    cases: Any = SimpleNamespace(outcomes=(o,), folders={0: Path("cases/0000")})
    return scores_page(data, cases, Path())


def _unexplained() -> str:
    told = verdict((), since="", consequences=consequences(gaps=()), status="partly_explained")
    many = {f"level_{i}_nm": Number(value=2.0, low=1.0, high=3.0, unit="N·m") for i in range(3)}
    two = tuple(told.differences[0].model_copy(update={"parameters": many}) for _ in range(2))
    changed: Verdict = told.model_copy(update={"differences": two, "warnings": ("The robot leans.",), "timeline": ()})
    made = a_diagnosis()
    return diagnosis_page(type(made)(changed, *[getattr(made, name) for name in list(made.__dataclass_fields__)[1:]]))


PAGES: Final[dict[str, Callable[[], str]]] = {
    "diagnosis": lambda: diagnosis_page(a_diagnosis()),
    "diagnosis with warnings": _unexplained,
    "history": _history,
    "improvement": _improvement,
    "evaluation": lambda: evaluation_page(evaluation(), "a_policy_of_mine.onnx"),
    "comparison": _comparison,
    "identification": _identification,
    "withheld scores": _scores,
    "run": lambda: page_html(replace(runs(RobotModel(), 1)[0], path=Path(__file__))),
}
"""Makes each kind of page, by what it is about."""
