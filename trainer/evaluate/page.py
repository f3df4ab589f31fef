"""The evaluation as one HTML page that needs nothing from a network."""

from __future__ import annotations

import json
from typing import Any

import plotly.graph_objects as go

from spot_log.page.kit import Html, escaped, facts, folded, page, plot, section, styled


def evaluation_page(result: dict[str, Any]) -> str:
    """The page's text."""
    figures = (_speed_figure(result), _error_figure(result), _gait_figure(result), _power_figure(result))
    body = [section("Summary", facts(_summary(result))), *(section("", plot(figure)) for figure in figures)]
    data = Html(f"<pre>{escaped(json.dumps(result, indent=1))}</pre>")
    return page(f"Policy {result['policy']}", [*body, section("", folded("All figures", data))])


def _summary(result: dict[str, Any]) -> list[tuple[str, Any]]:
    tracking, top = result["tracking"], result["top_speed"]
    rows = [
        ("Highest sustained speed, m/s", top["sustained_m_s"]),
        ("Flight share there", top["flight_share"]),
        ("Duty factors there (fl, fr, hl, hr)", top["duty_factors"]),
        ("Largest spread of duty factors at 0.5 m/s and more", tracking["worst_duty_spread"]),
        ("Mean forward error up to 5 m/s, m/s", tracking["mean_forward_error_m_s"]),
        ("Mean lateral error up to 3 m/s, m/s", tracking["mean_lateral_error_m_s"]),
        ("Mean yaw error up to 3 m/s, rad/s", tracking["mean_yaw_error_rad_s"]),
        ("Speed when told to stand, m/s", tracking["standing_speed_m_s"]),
        ("Peak torque, N·m", tracking["peak_torque_nm"]),
    ]
    for key in ("episodes_slow", "episodes_fast", "episodes_beyond"):
        if key in result:
            label = "at {} to {} m/s".format(*result[key]["v_x_m_s"])
            rows.append((f"Falls in {result[key]['episodes']} randomised episodes {label}", result[key]["falls"]))
            rows.append((f"Falls per hour {label}", result[key]["falls_per_hour"]))
    for key, label in (("pushes", "a push of 1 m/s"), ("slippery_patch", "a patch of μ 0.3")):
        rows.append((f"Survived {label}", f"{result[key]['survived']} of {result[key]['trials']}"))
    return rows


def _forward(result: dict[str, Any]) -> list[dict[str, Any]]:
    points = [p for p in result["tracking"]["points"] if p["command"][1] == 0.0 and p["command"][2] == 0.0]
    return sorted(points, key=lambda p: float(p["command"][0]))


def _speed_figure(result: dict[str, Any]) -> Any:
    curve = result["top_speed"]["curve"]
    asked = [c[0] for c in curve]
    figure = go.Figure(
        [
            go.Scatter(x=asked, y=asked, name="commanded", line={"dash": "dot", "color": "#999"}),
            go.Scatter(x=asked, y=[c[1] if c[2] else None for c in curve], name="measured", mode="lines+markers"),
        ]
    )
    return styled(figure, 380, title="Forward speed, held for 10 s", x="commanded V_x, m/s", y="mean V_x, m/s")


def _error_figure(result: dict[str, Any]) -> Any:
    figure = go.Figure()
    for axis, label in enumerate(("V_x, m/s", "V_y, m/s", "ω_z, rad/s")):
        others = [i for i in range(3) if i != axis]
        points = [p for p in result["tracking"]["points"] if all(p["command"][i] == 0.0 for i in others)]
        points.sort(key=lambda p: float(p["command"][axis]))
        x, y = [p["command"][axis] for p in points], [p["error"][axis] for p in points]
        figure.add_trace(go.Scatter(x=x, y=y, name=label, mode="lines+markers"))
    return styled(figure, 380, title="Tracking error, one command at a time", x="command", y="mean error")


def _gait_figure(result: dict[str, Any]) -> Any:
    points = [p for p in _forward(result) if not p["fell"]]
    x = [p["command"][0] for p in points]
    figure = go.Figure()
    for leg, name in enumerate(("fl", "fr", "hl", "hr")):
        figure.add_trace(go.Scatter(x=x, y=[p["duty_factors"][leg] for p in points], name=f"duty {name}"))
    figure.add_trace(go.Scatter(x=x, y=[p["flight_share"] for p in points], name="flight", line={"dash": "dash"}))
    return styled(figure, 380, title="Duty factors and flight share", x="commanded V_x, m/s", y="share of time")


def _power_figure(result: dict[str, Any]) -> Any:
    points = [p for p in _forward(result) if not p["fell"]]
    figure = go.Figure(go.Scatter(x=[p["command"][0] for p in points], y=[p["power_w"] for p in points]))
    return styled(figure, 380, title="Power (positive work of all motors)", x="commanded V_x, m/s", y="power, W")
