"""The operator's screen: mode, rates, ages, temperatures, battery and the last events, from the service's streams."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from spot_model.errors import SpotRlError
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES
from spot_protos import operator_pb2
from spot_tools.client import OperatorClient

EVENTS: Final = 8
PERIOD_S: Final = 0.25
WARM_C: Final = 60.0
HOT_C: Final = 70.0
_STATE_STYLES: Final = {
    "idle": "dim",
    "arming": "yellow",
    "armed": "bold yellow",
    "running": "bold green",
    "ending": "yellow",
}
_SEVERITY_STYLES: Final = {"info": "", "warning": "yellow", "error": "bold red"}


def watch_screen(client: OperatorClient, *, is_attending: bool) -> None:
    """Show the screen until Ctrl-C. Raises SpotRlError where the service refuses or goes away."""
    events: deque[operator_pb2.Event] = deque(maxlen=EVENTS)

    def follow() -> None:
        with contextlib.suppress(SpotRlError):
            for event in client.stream("StreamEvents", operator_pb2.StreamEventsRequest(past=EVENTS)):
                events.append(event)

    threading.Thread(target=follow, name="events", daemon=True).start()
    console = Console()
    with contextlib.suppress(KeyboardInterrupt), Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            status = client.call("GetStatus", operator_pb2.GetStatusRequest(), 5.0)
            if is_attending and status.state in ("armed", "running"):
                client.call("Attend", operator_pb2.AttendRequest(), 5.0)
            live.update(screen_of(status, list(events), is_attending=is_attending), refresh=True)
            time.sleep(PERIOD_S)


def screen_of(status: operator_pb2.Status, events: list[operator_pb2.Event], *, is_attending: bool) -> RenderableType:
    """Everything, drawn."""
    parts: list[RenderableType] = [Panel(_head(status, is_attending=is_attending), title="spot-rl", title_align="left")]
    if status.run.mode:
        side = Table.grid(expand=True, padding=(0, 1))
        side.add_column(ratio=1)
        side.add_column(ratio=1)
        side.add_row(
            Panel(_figures(status), title="control", title_align="left"),
            Panel(_body(status.run), title="robot", title_align="left"),
        )
        parts.append(side)
    elif status.last.outcome:
        parts.append(Panel(_last(status), title="last run", title_align="left"))
    parts.append(Panel(_events(events), title="events", title_align="left"))
    return Group(*parts)


def _head(status: operator_pb2.Status, *, is_attending: bool) -> Text:
    run = status.run
    text = Text()
    text.append(f" {status.state.upper()} ", style=f"reverse {_STATE_STYLES.get(status.state, '')}".strip())
    text.append(f"  {run.mode}" if run.mode else "  no lease is held, nothing is commanded", style="bold")
    text.append(f"   {run.robot_id or status.robot}", style="dim")
    text.append(f"   policy {run.policy}" if run.policy else "", style="dim")
    if status.attendance_left_s >= 0.0:
        left_s = max(0.0, status.attendance_left_s)
        style = "bold red" if left_s < 4.0 else ("green" if is_attending else "yellow")
        text.append(f"\n attended: sits down in {left_s:.0f} s without an operator", style=style)
    if run.mode and status.run_age_s > 1.0:
        text.append(f"\n no word from the control process for {status.run_age_s:.1f} s", style="bold red")
    return text


def _figures(status: operator_pb2.Status) -> Table:
    run = status.run
    table = _pairs()
    command = list(run.velocity_command) or [0.0] * 3
    measured = list(run.velocity_measured) or [float("nan")] * 3
    table.add_row("", Text(" forward    left    turn", style="dim"))
    table.add_row("command", f"{command[0]:+8.2f}{command[1]:+8.2f}{command[2]:+8.2f}  m/s, rad/s")
    table.add_row("measured", f"{measured[0]:+8.2f}{measured[1]:+8.2f}{measured[2]:+8.2f}")
    table.add_row("steered by", status.steered_by or "nobody")
    table.add_row("policy", f"{run.rate_hz:.2f} Hz, {run.ticks} ticks, {run.skipped_ticks} skipped")
    table.add_row("state age", f"p50 {run.state_age_p50_s * 1e3:.2f} ms, p99 {run.state_age_p99_s * 1e3:.2f} ms")
    table.add_row("tick", f"p50 {run.compute_p50_s * 1e6:.0f} µs, p99 {run.compute_p99_s * 1e6:.0f} µs")
    table.add_row("in control", f"{run.active_s:.1f} s")
    log = f"{run.log_path.rpartition('/')[2] or 'none'}"
    lost = f", {run.log_dropped} lost" if run.log_dropped else ""
    table.add_row("log", Text(log + lost, style="yellow" if run.log_dropped or run.log_problem else ""))
    return table


def charge_words(percent: float) -> str:
    """A battery's charge for a person."""
    return "not reported" if math.isnan(percent) else f"{percent:.0f} %"


def _body(run: operator_pb2.RunStatus) -> Table:
    table = _pairs()
    charge = run.battery_charge_percent
    style = "green" if charge >= 20.0 else ("yellow" if charge >= 10.0 else "bold red")  # NaN, too, is no good charge
    table.add_row("battery", Text(f"{charge_words(charge)}  {run.battery_voltage_v:.1f} V", style=style))
    table.add_row("motors", Text("on", style="bold") if run.motors_powered else Text("off", style="dim"))
    table.add_row("e-stop", Text("PRESSED", style="bold red") if run.estopped else Text("released", style="green"))
    table.add_row("tilt", f"{run.tilt_rad * 57.29578:.1f}°")
    table.add_row("faults", Text(", ".join(run.faults) or "none", style="bold red" if run.faults else ""))
    table.add_row("motors °C", Text("   hx   hy   kn", style="dim"))
    for leg in LEG_NAMES:
        row = Text()
        for joint in (name for name in JOINT_NAMES if name.startswith(leg)):
            value = run.motor_temperature_c.get(joint)
            if value is None:
                row.append("    –", style="dim")
            else:
                row.append(f"{value:5.0f}", style="bold red" if value > HOT_C else ("yellow" if value > WARM_C else ""))
        table.add_row(f"  {leg}", row)
    return table


def _last(status: operator_pb2.Status) -> Table:
    table = _pairs()
    table.add_row("ended", Text(status.last.outcome, style="" if status.last.exit_code in (0, 10) else "bold red"))
    table.add_row("why", status.last.sentence)
    for path in status.last.log_paths[-3:]:
        table.add_row("log", path.rpartition("/")[2])
    return table


def _events(events: list[operator_pb2.Event]) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    for event in events:
        stamp = time.strftime("%H:%M:%S", time.localtime(event.host_stamp_ns / 1e9))
        text.append(f"{stamp} ", style="dim")
        text.append(f"{event.name}: {event.text}\n", style=_SEVERITY_STYLES.get(event.severity, ""))
    text.rstrip()
    return text if events else Text("none yet", style="dim")


def _pairs() -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    return table
