"""The operator's service and the control process's end of its link, in process: requests in a row, and what is told."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rpcs import calls_in, in_a_row
from support import Target, folder


class Pumped:
    """In place of the supervisor's condition: whoever waits lets the service's own loop turn, as its thread would."""

    def __init__(self, supervisor: Any) -> None:
        self._supervisor, self._turns = supervisor, 0

    def __enter__(self) -> None:
        self._turns = 0

    def __exit__(self, *problem: object) -> None:
        pass

    def notify_all(self) -> None:
        """Nobody else is there."""

    def wait(self, timeout_s: float) -> None:
        """A turn; a control process that says nothing for long is at its end."""
        del timeout_s
        self._turns += 1
        if self._turns > 3:
            self._supervisor._run.process.code = 1
        self._supervisor.turn()


class StubRun:
    """A control process that answers as the input says."""

    pid = 1

    def __init__(self, supervisor: Any, script: list[bytes]) -> None:
        self._supervisor, self._script = supervisor, script
        self.code: int | None = None

    def tell(self, message: Any) -> bool:
        """Take a request; the answer comes at once, if there is one."""
        from spot_protos import run_link_pb2

        message.SerializeToString()
        said = self._script.pop() if self._script else b"\1"
        if not said:
            return False
        if message.request_id:
            answer = run_link_pb2.Answer(request_id=message.request_id, is_done=bool(said[0] & 1), text=repr(said))
            self._supervisor._take(run_link_pb2.FromRun(answer=answer))
        return True

    def read(self, timeout_s: float) -> list[Any]:
        """What it tells: the script's next bytes as a message."""
        from google.protobuf.message import DecodeError

        from spot_protos import run_link_pb2

        del timeout_s
        if not self._script:
            return []
        try:
            return [run_link_pb2.FromRun.FromString(self._script.pop())]
        except DecodeError:
            return []

    def exit_code(self) -> int | None:
        """Its end, where there is one."""
        return self.code

    def ask_to_stop(self) -> None:
        """A signal."""
        self.code = 0

    ask_to_damp = abort = kill = close = ask_to_stop


def operator(data: bytes) -> None:
    """Some requests in a row to one service, what the control process tells in between, and its end."""
    from spot_runtime.operator.door.access import Gate
    from spot_runtime.operator.door.callers import Caller, Role
    from spot_runtime.operator.server import supervisor as module
    from spot_runtime.operator.server.service import OperatorService

    calls = calls_in(data)
    script = [body for _, body in calls]
    supervisor = _supervisor()
    stub = StubRun(supervisor, script)
    service = OperatorService(supervisor, Gate(requests_per_s=1000.0, steering_per_s=1000.0))
    caller = Caller("user 1", "anna", Role.OPERATE)
    # Only for these calls: a service that another test starts in this process needs a control process that lives.
    started = patch.object(module.RunProcess, "start", staticmethod(lambda _: stub))
    with started:
        _call(supervisor, service, caller, calls)


def _call(supervisor: Any, service: Any, caller: Any, calls: Any) -> None:
    from google.protobuf.message import DecodeError
    from google.protobuf.message_factory import GetMessageClass

    from spot_protos import operator_pb2
    from spot_runtime.operator.door.access import Refusal
    from spot_runtime.operator.server.server import work_of

    methods = operator_pb2.DESCRIPTOR.services_by_name["Operator"].methods
    for chosen, body in calls:
        number = chosen[0] % (len(methods) + 2)
        if number >= len(methods):
            supervisor.turn() if supervisor._run is not None else None
            continue
        method = methods[number]
        request: Any = GetMessageClass(method.input_type)()
        try:
            request.ParseFromString(body)
        except DecodeError:
            continue
        with contextlib.suppress(Refusal):
            answer = work_of(service, method.name)(request, caller)
            if method.name in ("WatchStatus", "StreamEvents"):
                answer.aclose().close()
            else:
                answer.SerializeToString()
        if (supervisor._run is None) != (supervisor.state.value == "idle"):
            raise AssertionError(f"{supervisor.state.value} with run {supervisor._run}")


_shelf: Path | None = None


def _supervisor() -> Any:
    global _shelf  # noqa: PLW0603
    from spot_runtime.config import RunConfig
    from spot_runtime.host.service_manager import ServiceManager
    from spot_runtime.operator.server.supervisor import Supervisor

    if _shelf is None:
        _shelf = folder() / "shelf"
        _shelf.mkdir()
        (_shelf / "a.onnx").write_bytes(b"a")
    config = RunConfig.model_validate({"service": {"policies": str(_shelf)}})
    supervisor = Supervisor("127.0.0.1", config, manager=ServiceManager(), tell=lambda _: None)
    supervisor._at._changed = Pumped(supervisor)  # type: ignore[assignment]
    return supervisor


def operator_seeds() -> list[bytes]:
    from spot_protos import operator_pb2 as pb
    from spot_protos import run_link_pb2

    names = [method.name for method in pb.DESCRIPTOR.services_by_name["Operator"].methods]
    number = {name: bytes([index]) for index, name in enumerate(names)}
    armed = run_link_pb2.FromRun(state="armed").SerializeToString()
    running = run_link_pb2.FromRun(state="running").SerializeToString()
    status = run_link_pb2.FromRun(status=pb.RunStatus(mode="active", velocity_command_low=[-1, -1, -1]))
    ended = run_link_pb2.FromRun(ended=pb.Outcome(outcome="completed", sentence="done")).SerializeToString()
    turn = bytes([len(names)])
    arm = number["Arm"] + pb.ArmRequest(policy="a", labels={"k": "v"}, operator="x").SerializeToString()
    each = [
        number["GetStatus"],
        number["ListModes"],
        number["ListPolicies"],
        number["WatchStatus"] + pb.WatchStatusRequest(rate_hz=10.0).SerializeToString(),
        number["StreamEvents"] + pb.StreamEventsRequest(past=3).SerializeToString(),
        number["SwitchPolicy"] + pb.SwitchPolicyRequest(policy="a", sha256="0" * 64).SerializeToString(),
        number["StartLog"] + pb.StartLogRequest(labels={"a": "b"}).SerializeToString(),
        number["LabelLog"] + pb.LabelLogRequest(labels={"a": "b"}).SerializeToString(),
        number["Attend"],
        number["Start"],
        number["Stop"] + pb.StopRequest(keep_standing=True).SerializeToString(),
        number["Damp"],
        number["SetVelocity"] + pb.SetVelocityRequest(v_x_m_s=0.5, operator="x").SerializeToString(),
    ]
    rows = [[arm, *each[:6], turn + armed], [arm, *each[5:], turn + armed], [turn + ended, turn + armed, arm]]
    rows += [[arm, each[9], each[12], turn + status.SerializeToString(), turn + running, turn + armed], each]
    return [in_a_row(row) for row in rows]


def operated_stub() -> Any:
    """As much of an operated run as requests act on: they are the product's own, what they act on is counted."""
    from types import SimpleNamespace

    from spot_runtime.config import RunConfig
    from spot_runtime.operator.run.requests import Requests

    class Operated(Requests):
        log_path = ""

        def __init__(self) -> None:
            self.link = SimpleNamespace(answer=self._answer)  # type: ignore[assignment]
            self.source = SimpleNamespace(steer=lambda *_: None)  # type: ignore[assignment]
            self.background = SimpleNamespace(is_busy=False, run=self._carry_out)  # type: ignore[assignment]
            self.loop: Any = None
            self.policy: Any = None
            self.config = RunConfig()
            self.start_asked: Any = None
            self.keeps_standing = False
            self.answers = 0

        def _answer(self, request_id: int, *, is_done: bool, text: str) -> None:
            del request_id, is_done
            self.answers += 1
            if not text:
                raise AssertionError("an answer without a word")

        def _carry_out(self, work: Any, then: Any) -> None:
            try:
                result, problem = work(), None
            except Exception as error:  # noqa: BLE001 - as the background task does
                result, problem = None, error
            then(result, problem)

        def end(self, stop: Any) -> None:
            del stop

        def open_log(self, labels: dict[str, str]) -> Any:
            return labels

        def begin_log(self, log: Any) -> Path:
            self.log_path = f"{len(log)}.mcap"
            return Path(self.log_path)

        def event(self, name: Any, text: str) -> None:
            name.label.encode()
            text.encode()

    return Operated()


def run_link(data: bytes) -> None:
    """Requests to the control process, some in a row; each is answered once."""
    from types import SimpleNamespace

    from google.protobuf.message import DecodeError

    from spot_protos import run_link_pb2
    from spot_runtime.control.modes import Mode

    run = operated_stub()
    for chosen, body in calls_in(data):
        try:
            message = run_link_pb2.ToRun.FromString(body)
        except DecodeError:
            continue
        modes = list(Mode)
        run.loop = None if chosen[0] % 2 else SimpleNamespace(mode=modes[chosen[0] // 2 % len(modes)], ending=None)
        before = run.answers
        run.handle(message, 1)
        run.refuse_start("the hand-over failed")
        if run.answers != before + 1:
            raise AssertionError(f"{run.answers - before} answers to one request")


def run_link_seeds() -> list[bytes]:
    from spot_protos import operator_pb2 as pb
    from spot_protos import run_link_pb2 as link

    messages = [
        link.ToRun(request_id=1, start=pb.StartRequest()),
        link.ToRun(request_id=2, start_log=pb.StartLogRequest(labels={"a": "b"})),
        link.ToRun(request_id=3, label_log=pb.LabelLogRequest(labels={"a": "b"})),
        link.ToRun(request_id=4, switch_policy=link.SwitchPolicy(path="x.onnx", sha256="0" * 64)),
        link.ToRun(velocity=link.Velocity(v_x_m_s=0.5)),
        link.ToRun(request_id=5, stop=pb.StopRequest(keep_standing=True)),
        link.ToRun(request_id=6, damp=pb.DampRequest()),
        link.ToRun(attend=pb.AttendRequest()),
    ]
    bodies = [message.SerializeToString() for message in messages]
    return [in_a_row([b"\1" + body for body in bodies]), in_a_row([bytes([2 * i]) + b for i, b in enumerate(bodies)])]


OPERATOR = ("spot_runtime.operator",)
STATES = (b"idle", b"arming", b"armed", b"running", b"ending", b"active", b"ramping_in")
OPERATOR_RPCS = {
    "operator": Target(operator, operator_seeds, OPERATOR, 512, STATES, "a new service, and twelve calls, an input"),
    "run_link": Target(run_link, run_link_seeds, OPERATOR, 512, STATES),
}
