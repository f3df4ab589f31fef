"""The Foxglove layout of a comparison: the robot with its ghost, velocities, and what each joint does otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from spot_log.format.viewer import BODY_FRAME, ODOM_FRAME
from spot_model.robot.facts import JOINT_TYPES, LEG_NAMES

_LEG_COLOURS: Final = ("#e4572e", "#4e9a3b", "#2f6db5", "#b04fa0")
_JOINTS: Final = {"hx": "hips, sideways", "hy": "hips", "kn": "knees"}
_SIGNALS: Final = {"position": "position of {}, rad", "effort": "load of {}, N·m"}


def foxglove_layout() -> dict[str, Any]:
    """The layout as Foxglove imports it from a file."""
    velocities = {
        "commanded": ("/command.linear_velocity.x", "#9aa7b2"),
        "robot": ("/odometry.linear_velocity.x", "#f2c21b"),
        "ghost": ("/ghost/odometry.linear_velocity.x", "#59a6ff"),
    }
    panels = {"3D!compare": _scene(), "Plot!velocity": _plot("Forward velocity, m/s", velocities)}
    for joint in JOINT_TYPES:
        for signal, title in _SIGNALS.items():
            lines = {
                leg: (f'/ghost/difference.joints[:]{{name=="{leg}_{joint}"}}.{signal}', colour)
                for leg, colour in zip(LEG_NAMES, _LEG_COLOURS, strict=True)
            }
            panels[f"Plot!{signal}_{joint}"] = _plot(f"Ghost less robot, {title.format(_JOINTS[joint])}", lines)
    panels["RosOut!log"] = {
        "searchTerms": [],
        "minLogLevel": 1,
        "topicToRender": "/log",
        "foxglovePanelTitle": "What the diagnosis says",
    }
    left = _split("column", "3D!compare", _split("column", "Plot!velocity", "RosOut!log", 70), 60)
    positions, loads = (
        _split("column", f"Plot!{s}_kn", _split("column", f"Plot!{s}_hy", f"Plot!{s}_hx", 50), 34) for s in _SIGNALS
    )
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", left, _split("row", positions, loads, 50), 45),
    }


def _split(direction: str, first: Any, second: Any, percent: int) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percent}


def _plot(title: str, lines: Mapping[str, tuple[str, str]]) -> dict[str, Any]:
    """A plot over time; ``lines`` are message paths with their colours, by their label."""
    shared = {"enabled": True, "timestampMethod": "receiveTime"}
    return {
        "foxglovePanelTitle": title,
        "paths": [{"value": path, **shared, "label": label, "color": c} for label, (path, c) in lines.items()],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "left",
        "showPlotValuesInLegend": False,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 150,
        "followingViewWidth": 20,
    }


def _scene() -> dict[str, Any]:
    """The robot and its ghosts, seen from a place that goes with the robot, on a grid below its feet."""
    camera = {"perspective": True, "distance": 3.4, "phi": 62, "thetaOffset": 40, "targetOffset": [0, 0, -0.1]}
    target = {"target": [0, 0, 0], "targetOrientation": [0, 0, 0, 1], "fovy": 45, "near": 0.05, "far": 500}
    grid = {"visible": True, "frameLocked": True, "label": "Grid", "instanceId": "grid", "layerId": "foxglove.Grid"}
    lines = {"frameId": ODOM_FRAME, "size": 20, "divisions": 20, "lineWidth": 1, "color": "#8890a055"}
    unused = {"poseTopic": "/unused_pose", "pointTopic": "/unused_point", "poseEstimateTopic": "/unused_estimate"}
    return {
        "cameraState": {**camera, **target},
        "followMode": "follow-position",
        "followTf": BODY_FRAME,
        "scene": {
            "transforms": {"enablePreloading": False, "showLabel": False, "lineWidth": 0, "axisScale": 0},
            "backgroundColor": "#20242b",
        },
        "transforms": {f"frame:{frame}": {"visible": True} for frame in (ODOM_FRAME, BODY_FRAME)},
        "topics": {"/scene": {"visible": True}},
        "layers": {"grid": {**grid, **lines, "position": [0, 0, -0.55], "rotation": [0, 0, 0], "order": 1}},
        "publish": {"type": "point", **unused},
        "imageMode": {},
        "foxglovePanelTitle": "The robot, and ghosts beside it",
    }
