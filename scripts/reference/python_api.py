"""docs/reference/python.md: every name of the package spot_rl, from its docstring."""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
from typing import Any, ForwardRef, get_args

import spot_rl
from compare.differences import Differences, SignalDifference
from compare.tracks import Track
from diagnosis.document import (
    CalibratedNumber,
    Calibration,
    Consequences,
    Difference,
    GapCell,
    GapChange,
    GapLeft,
    Number,
    QuantityChange,
    Shrink,
    Status,
    Verdict,
)
from spot_log.format.records import EventRecord, RunHeader
from spot_log.read import run as tables
from spot_log.tools.gaits import GaitSpan
from spot_model.policy.contract import PolicyContract, StatedGait, TrainingRecord
from spot_model.policy.observation import COLUMNS, OBSERVATION
from spot_model.robot.gait import Gait
from trainer.sysid.measured import MeasuredData
from trainer.sysid.result import ResultData
from trainer.sysid.verdict import ParameterVerdict

from .words import attribute_docs, page, plain, table

ABOUT = """\
All public names of `spot_rl`. Each is imported when it is first used, so `import spot_rl` is fast. Paths may be strings
or `pathlib.Path`. Invalid input raises `spot_rl.SpotRlError`; the message says what is allowed. For an introduction,
see [Python](../python.md)."""
SECTION = re.compile(r"^(Args|Returns|Raises):\n", re.MULTILINE)
ITEM = re.compile(r"^(\w[\w ]*): ", re.MULTILINE)
EXAMPLE = re.compile(r"::\n\n((?:    .*\n?)+)")
ARRAYS = (
    ("Run.header", RunHeader),
    ("Run.states", tables.StateTable),
    ("Run.commands", tables.CommandTable),
    ("Run.ticks", tables.TickTable),
    ("Run.slow_states", tables.SlowTable),
    ("Run.states.imu", tables.ImuTable),
    ("an entry of Run.events", EventRecord),
    ("an entry of gaits(run)", GaitSpan),
    ("gaits(run)[i].gait", Gait),
    ("Policy.contract", PolicyContract),
    ("Policy.contract.training", TrainingRecord),
    ("an entry of Policy.contract.gait", StatedGait),
    ("an entry of Comparison.tracks", Track),
    ("an entry of Comparison.differences", Differences),
    ("an entry of Differences.signals", SignalDifference),
    ("Verdict", Verdict),
    ("an entry of Verdict.where", GapCell),
    ("an entry of Verdict.differences", Difference),
    ("a value of Difference.parameters", Number),
    ("Difference.consequences", Consequences),
    ("an entry of Consequences.gaps", GapChange),
    ("an entry of Consequences.changes", QuantityChange),
    ("Verdict.calibration", Calibration),
    ("an entry of Calibration.numbers", CalibratedNumber),
    ("an entry of Verdict.remainder", GapLeft),
    ("Verdict.shrink", Shrink),
    ("ResultData", ResultData),
    ("an entry of ResultData.parameters", ParameterVerdict),
    ("an entry of ResultData.measured", MeasuredData),
)

OF_THE_RUNTIME = ("tick", "warm_up", "observe", "observe_many", "gains", "with_joints_in_policy_order", "close_extras")
"""Methods that take or return what only the runtime has; the page does not describe it."""


def python_page() -> str:
    """The page."""
    named = [(name, getattr(spot_rl, name)) for name in spot_rl.__all__]
    functions = [_function(name, found) for name, found in named if inspect.isfunction(found)]
    classes = [_class(name, found) for name, found in named if inspect.isclass(found)]
    fields = [f"### {where}\n\n{_fields(cls)}" for where, cls in ARRAYS]
    parts = ["## Functions\n", *functions, "## Classes\n", *classes, "## What they hold\n", *fields, _observation()]
    return page("Python reference", ABOUT, parts)


def _observation() -> str:
    """The layout of the 48 numbers."""
    rows = [
        (f"`{field.name}`", f"{COLUMNS[field.name].start} to {COLUMNS[field.name].stop - 1}", field.unit, field.source)
        for field in OBSERVATION
    ]
    return f"### The observation\n\n48 numbers, float32.\n\n{table(('part', 'columns', 'unit', 'source'), rows)}"


def _function(name: str, function: Any, prefix: str = "spot_rl.", level: str = "###") -> str:
    return f"{level} {name}\n\n```python\n{prefix}{name}{_signature(function)}\n```\n\n{_docstring(function)}"


def method_text(method: Any) -> str:
    """A method's signature and docstring."""
    return f"```python\n{method.__name__}{_signature(method)}\n```\n\n{_docstring(method)}"


def _signature(function: Any) -> str:
    parameters = list(inspect.signature(function).parameters.values())
    shown, is_keyword_only = [], False
    for p in parameters:
        if p.name == "self":
            continue
        if p.kind is p.KEYWORD_ONLY and not is_keyword_only:
            shown.append("*")
            is_keyword_only = True
        annotation = "" if p.annotation is p.empty else f": {p.annotation}".replace("AnyPath", "path")
        default = "" if p.default is p.empty else f" = {p.default!r}"
        shown.append(f"{'*' * (p.kind is p.VAR_POSITIONAL)}{p.name}{annotation}{default}")
    result = inspect.signature(function).return_annotation
    returns = "" if result is inspect.Signature.empty else f" -> {result}"
    shown, returns = [s.replace("Numbers", "array") for s in shown], returns.replace("Numbers", "array")
    one = f"({', '.join(shown)}){returns}"
    return one if len(one) < 90 else "(\n    " + ",\n    ".join(shown) + f",\n){returns}"


def _docstring(found: Any) -> str:
    text = plain(found.__doc__ or "")
    about, *rest = SECTION.split(text)
    parts = [EXAMPLE.sub(lambda match: f"```python\n{textwrap.dedent(match[1]).rstrip()}\n```", about.strip())]
    for title, body in zip(rest[::2], rest[1::2], strict=True):
        lines = inspect.cleandoc(body)
        items = ITEM.sub(lambda match: f"- `{match[1]}`: ", lines) if title != "Returns" else lines
        parts.append(f"*{title}*\n\n{items}" if items.startswith("-") else f"*{title}*: {items}")
    return "\n\n".join(parts) + "\n"


def _class(name: str, cls: Any) -> str:
    has_own_arguments = "Args:" in (cls.__doc__ or "") and not dataclasses.is_dataclass(cls)
    begun = f"```python\nspot_rl.{name}{_signature(cls.__init__)}\n```\n\n" if has_own_arguments else ""
    lines = [f"### {name}\n\n{begun}{_docstring(cls)}"]
    own = {
        k: v for base in reversed(cls.__mro__[:-1]) for k, v in vars(base).items() if base.__module__ == cls.__module__
    }
    if dataclasses.is_dataclass(cls):
        lines.append(_fields(cls))
    properties = [(f"`{k}`", plain(v.__doc__ or "")) for k, v in own.items() if isinstance(v, property)]
    lines.append(table(("property", "what it is"), properties))
    lines += [
        _function(k, v, prefix=f"{name}.", level="####")
        for k, v in own.items()
        if inspect.isfunction(v) and not k.startswith("_") and k not in OF_THE_RUNTIME and v.__doc__
    ]
    return "\n".join(line for line in lines if line)


def _fields(cls: Any) -> str:
    docs = attribute_docs(cls)
    names = cls.model_fields if hasattr(cls, "model_fields") else cls.__annotations__
    kinds = {
        k: str(v).replace("NDArray[np.", "array of ").replace("_]", "").rstrip("]") if "NDArray" in str(v) else v
        for k, v in cls.__annotations__.items()
    }
    rows = [(f"`{name}`", _kind(kinds.get(name, "")), docs.get(name, "")) for name in names]
    return table(("attribute", "type", "what it is"), rows)


def _kind(annotation: Any) -> str:
    if isinstance(annotation, ForwardRef):
        annotation = annotation.__forward_arg__
    if annotation == "Status":
        return " or ".join(f"`{value}`" for value in get_args(Status))
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    return {"Array": "array of numbers", "Ints": "array of integers", "Flags": "array of booleans"}.get(text, text)
