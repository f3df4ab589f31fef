"""Operate a robot through 'spot-rl serve'.

A stop must not wait for libraries: what only steering and the screen need is imported there.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from google.protobuf.json_format import MessageToDict

from spot_protos import operator_pb2
from spot_runtime.session.labels import parse_labels
from spot_tools.client import ARM_TIMEOUT_S, OperatorClient, RefusedError, client_from

if TYPE_CHECKING:
    from spot_runtime.sources import CommandSource

app = typer.Typer(no_args_is_help=True, add_completion=False)
STEER_PERIOD_S = 0.04
BEFORE_CONTROL = ("", "standing by", "ready", "activating", "ramping_in")
"""Modes that a run tells between its start and full control; it tells them late, a few times a second."""

Label = Annotated[list[str] | None, typer.Option("--label", help="KEY=VALUE; repeatable.")]
Sha256 = Annotated[str, typer.Option(help="Refuse a policy file with another digest.")]


@app.callback()
def ctl(
    context: typer.Context,
    address: Annotated[
        str | None,
        typer.Option(help="unix:/path or HOST:PORT; also SPOT_RL_OPERATOR; default: the service on this computer."),
    ] = None,
    ca: Annotated[Path | None, typer.Option(help="PEM file that signed the service's certificate.")] = None,
    cert: Annotated[Path | None, typer.Option(help="PEM file: your certificate.")] = None,
    key: Annotated[Path | None, typer.Option(help="PEM file: its key.")] = None,
) -> None:
    """Operate a robot through 'spot-rl serve': status, arm, start, steer, stop."""
    context.obj = lambda: client_from(address, ca, cert, key)


@app.command()
def status(context: typer.Context, as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False) -> None:
    """Show state, mode, figures, and how the last run ended."""
    from spot_tools.watch import charge_words

    with _client(context) as client:
        answer = client.call("GetStatus", operator_pb2.GetStatusRequest())
    if as_json:
        typer.echo(json.dumps(MessageToDict(answer, preserving_proto_field_name=True)))
        return
    run = answer.run
    typer.echo(f"state    {answer.state}" + (f", {run.mode}, policy {run.policy}" if run.mode else ""))
    typer.echo(f"robot    {answer.robot} {run.robot_id}".rstrip())
    if run.mode:
        typer.echo(f"battery  {charge_words(run.battery_charge_percent)}")
        typer.echo(f"log      {run.log_path or 'none'}")
    if answer.last.outcome:
        typer.echo(f"last run {answer.last.outcome}: {answer.last.sentence}")


@app.command()
def modes(context: typer.Context) -> None:
    """List the states of the service and the modes of the control loop, and the commands allowed in each."""
    with _client(context) as client:
        answer = client.call("ListModes", operator_pb2.ListModesRequest())
    for mode in answer.states:
        typer.echo(f"{mode.name:<12} {mode.meaning}; may be asked: {', '.join(mode.allows)}")
    for mode in answer.modes:
        typer.echo(f"  {mode.name:<12} {mode.meaning}")


@app.command()
def policies(context: typer.Context) -> None:
    """List the policies that may be armed."""
    with _client(context) as client:
        answer = client.call("ListPolicies", operator_pb2.ListPoliciesRequest())
    for policy in answer.policies:
        note = "" if policy.is_allowed else "  (its digest or signature is not as the configuration wants it)"
        typer.echo(f"{policy.name:<20} {policy.sha256}{note}")


@app.command()
def arm(
    context: typer.Context,
    policy: Annotated[str, typer.Argument(help="Name of the policy, as 'spot-rl ctl policies' lists it.")],
    sha256: Sha256 = "",
    label: Label = None,
    operator: Annotated[str, typer.Option(help="Your name, for status and logs.")] = "",
) -> None:
    """Take the lease, power on and let the vendor's controller stand. THE ROBOT STANDS UP."""
    request = operator_pb2.ArmRequest(policy=policy, sha256=sha256, labels=parse_labels(label or []), operator=operator)
    _ask(context, "Arm", request, ARM_TIMEOUT_S)


@app.command()
def start(context: typer.Context) -> None:
    """Hand the joints to the policy. THE ROBOT MOVES."""
    _ask(context, "Start", operator_pb2.StartRequest())


@app.command()
def stop(
    context: typer.Context,
    keep_standing: Annotated[bool, typer.Option("--keep-standing", help="Stay armed, standing.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="Return when the robot is at rest.")] = False,
) -> None:
    """Stop in place, hand back, sit and power off."""
    with _client(context) as client:
        answer = client.call("Stop", operator_pb2.StopRequest(keep_standing=keep_standing))
        typer.echo(answer.text)
        rest = ("idle", "armed") if keep_standing else ("idle",)  # right after a stop it may still be armed
        while wait:
            status = client.call("GetStatus", operator_pb2.GetStatusRequest())
            if status.state in rest:
                typer.echo(status.state if status.state == "armed" else f"idle; {status.last.sentence}")
                return
            time.sleep(0.2)


@app.command()
def damp(context: typer.Context) -> None:
    """Damp the joints at once: the robot sinks to the ground."""
    _ask(context, "Damp", operator_pb2.DampRequest())


@app.command(context_settings={"ignore_unknown_options": True})  # -0.2 is a velocity, not an option
def velocity(
    context: typer.Context,
    v_x: Annotated[float, typer.Argument(help="Forward, m/s.")],
    v_y: Annotated[float, typer.Argument(help="Left, m/s.")] = 0.0,
    yaw_rate: Annotated[float, typer.Argument(help="Turn to the left, rad/s.")] = 0.0,
    seconds: Annotated[
        float, typer.Option("--for", min=0.1, max=600.0, help="Duration, s; then the velocity fades to zero.")
    ] = 2.0,
    operator: Annotated[str, typer.Option(help="Who steers.")] = "ctl velocity",
) -> None:
    """Steer for a while, once the policy is in full control."""
    request = operator_pb2.SetVelocityRequest(v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw_rate, operator=operator)
    with _client(context) as client:
        _wait_until_active(client)
        typer.echo(f"steering for {seconds:g} s: {v_x:+.2f} {v_y:+.2f} m/s {yaw_rate:+.2f} rad/s")
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            client.call("SetVelocity", request, 2.0)
            time.sleep(STEER_PERIOD_S)


@app.command()
def drive(
    context: typer.Context,
    gamepad: Annotated[bool, typer.Option("--gamepad", help="Hold the dead-man button and use the sticks.")] = False,
    operator: Annotated[str, typer.Option(help="Who steers.")] = "ctl drive",
) -> None:
    """Steer by keyboard or gamepad until you press x."""
    from spot_runtime.config import OperatorConfig
    from spot_runtime.host.journal import Console
    from spot_tools.sources import manual_source

    console = Console()
    with _client(context) as client:
        try:
            drive_by(client, manual_source(OperatorConfig(), console.say, is_gamepad=gamepad), operator)
        finally:
            console.close()


@app.command("switch-policy")
def switch_policy(
    context: typer.Context, policy: Annotated[str, typer.Argument(help="Name of the policy.")], sha256: Sha256 = ""
) -> None:
    """Load another policy while the vendor's controller stands."""
    _ask(context, "SwitchPolicy", operator_pb2.SwitchPolicyRequest(policy=policy, sha256=sha256))


@app.command("start-log")
def start_log(context: typer.Context, label: Label = None) -> None:
    """Start a log while standing; otherwise the log begins with 'start'."""
    with _client(context) as client:
        answer = client.call("StartLog", operator_pb2.StartLogRequest(labels=parse_labels(label or [])))
    typer.echo(answer.path)


@app.command("label-log")
def label_log(context: typer.Context, labels: Annotated[list[str], typer.Argument(help="KEY=VALUE ...")]) -> None:
    """Label the log that is being written."""
    _ask(context, "LabelLog", operator_pb2.LabelLogRequest(labels=parse_labels(labels)))


@app.command()
def events(
    context: typer.Context,
    past: Annotated[int, typer.Option(min=0, max=500, help="Start with this many past events.")] = 20,
    follow: Annotated[bool, typer.Option("--follow", help="Keep printing new events.")] = False,
) -> None:
    """Show the last events."""
    with _client(context) as client:
        left = min(past, client.call("GetStatus", operator_pb2.GetStatusRequest()).events)
        if not left and not follow:
            return
        for event in client.stream("StreamEvents", operator_pb2.StreamEventsRequest(past=past)):
            stamp = time.strftime("%H:%M:%S", time.localtime(event.host_stamp_ns / 1e9))
            typer.echo(f"{stamp} {event.severity:<7} {event.name}: {event.text}")
            left -= 1
            if left <= 0 and not follow:
                return


@app.command()
def attend(context: typer.Context) -> None:
    """Confirm once that an operator is present; 'spot-rl ctl watch --attend' does so continuously."""
    _ask(context, "Attend", operator_pb2.AttendRequest())


@app.command()
def watch(
    context: typer.Context,
    is_attending: Annotated[
        bool, typer.Option("--attend", help="Confirm that an operator is present, as long as this runs.")
    ] = False,
) -> None:
    """Show everything on one screen: mode, rates, ages, temperatures, battery, the last events. Ctrl-C leaves it."""
    from spot_tools.watch import watch_screen

    with _client(context) as client:
        watch_screen(client, is_attending=is_attending)


def _client(context: typer.Context) -> OperatorClient:
    client: OperatorClient = context.obj()
    return client


def _ask(context: typer.Context, name: str, request: Any, timeout_s: float | None = None) -> None:
    with _client(context) as client:
        typer.echo(client.call(name, request, timeout_s).text)


def _wait_until_active(client: OperatorClient) -> None:
    while True:
        status = client.call("GetStatus", operator_pb2.GetStatusRequest())
        if status.state != "running" or status.run.mode not in BEFORE_CONTROL:
            return
        client.call("Attend", operator_pb2.AttendRequest())
        time.sleep(0.1)


def drive_by(client: OperatorClient, source: CommandSource, operator: str) -> None:
    """Send what the source says until it is finished; then stop the robot in place and let it sit.

    A velocity beyond the policy's range is cut to it. While the policy is not in full control nothing is sent but
    that somebody attends.
    """
    began_ns = time.monotonic_ns()
    try:
        while True:
            now_ns = time.monotonic_ns()
            wanted = source.sample((now_ns - began_ns) / 1e9, now_ns)
            if wanted.is_finished:
                client.call("Stop", operator_pb2.StopRequest())
                return
            _steer(client, wanted.command.tolist(), operator)
            time.sleep(STEER_PERIOD_S)
    finally:
        source.close()


def _steer(client: OperatorClient, velocity: list[float], operator: str) -> None:
    run = client.call("GetStatus", operator_pb2.GetStatusRequest()).run
    if run.mode != "active":
        client.call("Attend", operator_pb2.AttendRequest())
        return
    low, high = run.velocity_command_low, run.velocity_command_high
    v_x, v_y, yaw = (min(max(v, lo), hi) for v, lo, hi in zip(velocity, low, high, strict=True))
    request = operator_pb2.SetVelocityRequest(v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw, operator=operator)
    try:
        client.call("SetVelocity", request, 2.0)
    except RefusedError:
        client.call("Attend", operator_pb2.AttendRequest())  # the mode has just changed
