"""docs/reference/effects.md: every effect, as it acts and as it looks."""

from __future__ import annotations

import inspect
import textwrap
from pathlib import Path

from diagnosis.channels import CHANNEL_TITLES
from diagnosis.library.registry import LIBRARY
from spot_model.effects import base
from spot_model.effects.base import Effect, Hook
from spot_model.effects.registry import BUILT_IN

from .python_api import method_text
from .words import attribute_docs, page, plain, table

HOOKS = {
    Hook.MODEL: ("edit", "The physics model, once, before the first step"),
    Hook.TORQUE: ("torque", "The motor torque, at every physics step"),
    Hook.SOFTWARE: ("setpoint_rad", "The set-point that the program sends"),
    Hook.COMMAND: ("arrival_s", "The way of a command from the policy to the servos"),
    Hook.SENSOR: ("read", "What the joints' sensors report"),
    Hook.ESTIMATE: ("estimate", "What the state estimator reports of the body"),
    Hook.OUTSIDE: ("surround", "Gravity and forces on the feet, at every physics step"),
}
PICTURES = Path(__file__).resolve().parents[2] / "docs" / "reference" / "effects"
ABOUT = """\
An *effect* is a physical phenomenon that a simulator may lack: friction, a limit, a delay, backlash. These effects
are built in, and shared by the fake robot, identification, diagnosis and training. In a [model file](files.md) an
effect is one line:

```yaml
- {effect: coulomb_friction, joints: [knees], level_nm: 0.4}
```

`joints` takes joint names (`fl_hx` … `hr_kn`), `hips`, `knees`, `all`, or a leg (`fl`, `fr`, `hl`, `hr`). At its
*null* value a parameter has no influence at all. *Looks like* describes the effect in a log, and *shows in* lists the
channels of the diagnosis that show it. *Confused with* lists effects that look similar, and *told apart by* the
recording that distinguishes them. Each picture shows the front left knee over 0.6 s of walking in the paper's
identified model, without (grey) and with the effect (red), from the same start. To write your own, see
[below](#effects-of-your-own) and [add an effect](../add-an-effect.md)."""
OWN = """\
## Effects of your own

A frozen, keyword-only dataclass derived from one of these classes of `spot_model.effects.base`, with one method. Each
parameter is a field `NAME: Any = parameter(null=…, low=…, high=…, unit="…", source="…")`; `self.mask` tells the joints
on which the effect acts, shape (12,). Arrays hold one row per simulated robot and twelve joints in the order fl, fr,
hl, hr × hx, hy, kn. A model effect edits fields of the MuJoCo model: `fields["dof_damping"][:, fields.joint_dofs]` has
shape (n, 12), and `fields.body_id(NAME)` and `fields.geom_id(NAME)` find bodies and geoms. Write the formula with
operators and methods of arrays, so that it runs on NumPy and torch.

```python
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import TorqueEffect, parameter


@dataclass(frozen=True, kw_only=True)
class OilDrag(TorqueEffect):
    \"""Drag that grows with the square of the speed.\"""

    name: ClassVar[str] = "oil_drag"
    drag_nm_s2_per_rad2: Any = parameter(null=0.0, low=0.0, high=1.0, unit="N·m·s²/rad²", source="my gearbox")

    def torque(self, torque_nm, motion, memory):
        speed = motion.velocity_rad_s
        return torque_nm - self.drag_nm_s2_per_rad2 * speed * abs(speed), memory
```

Put it into a file of its own, not into the script that uses it. In a file `my_effects.py`, it is `my_effects:OilDrag`
wherever an effect is named, if the file's folder is on `PYTHONPATH`, in full. In Python, `spot_rl.load_model(MODEL,
effects=[OilDrag(joints=("knees",), drag_nm_s2_per_rad2=0.1)])` adds it to a model, and `spot_rl.diagnose(...,
add_effects=[OilDrag])` looks for it in logs. The diagnosis can look for torque effects, and for model effects that edit
friction, damping or rotor inertia.
"""


def effects_page() -> str:
    """The page."""
    rows = []
    for name, cls in sorted(BUILT_IN.items()):
        rows.append((f"[`{name}`](#{name})", _title(name), cls.hook.value, ", ".join(p.unit for p in cls.parameters())))
    parts = [table(("effect", "what it is", "hook", "units"), rows)]
    for hook, (_, about) in HOOKS.items():
        found = sorted((n, c) for n, c in BUILT_IN.items() if c.hook is hook)
        if found:
            parts += [f"\n## Hook: {hook.value}\n\n{about}.\n", *(section(name, cls) for name, cls in found)]
    return page("Effects", ABOUT, [*parts, "\n" + OWN, *_bases()])


def _bases() -> list[str]:
    """The classes that an effect is derived from, and what its formula is given."""
    found = []
    hooks = (base.ModelEffect, base.TorqueEffect, base.SoftwareEffect, base.CommandEffect)
    for cls in (*hooks, base.SensorEffect, base.EstimateEffect, base.OutsideEffect):
        method = getattr(cls, HOOKS[cls.hook][0])
        found.append(f"### {cls.__name__}\n\n{plain(cls.__doc__ or '')}\n\n{method_text(method)}")
    for given in (base.Motion, base.JointReading, base.BodyEstimate, base.Outside):
        rows = [(f"`{name}`", text) for name, text in attribute_docs(given).items()]
        found.append(f"### {given.__name__}\n\n{plain(given.__doc__ or '')}\n\n{table(('attribute', 'what'), rows)}")
    return found


def section(name: str, cls: type[Effect]) -> str:
    """One effect."""
    told, _, source = plain(cls.__doc__ or "").partition("Source:")
    parameters = table(
        ("parameter", "unit", "null", "range", "source"),
        [(f"`{p.name}`", p.unit, f"{p.null:g}", f"{p.low:g} to {p.high:g}", p.source) for p in cls.parameters()],
    )
    lines = [f"### {name}", f"*{_title(name).capitalize()}.* {told.strip()}"]
    if (PICTURES / f"{name}.svg").is_file():
        lines.append(f"![{name}: a knee without and with it](effects/{name}.svg)")
    lines += [parameters.rstrip(), _look(name)]
    if source:
        lines.append(f"Source: {' '.join(source.split())}")
    method = HOOKS[cls.hook][0]
    code = textwrap.dedent(inspect.getsource(getattr(cls, method))).rstrip()
    lines.append(
        f"<details markdown='1'><summary>The formula, as it runs</summary>\n\n```python\n{code}\n```\n\n</details>"
    )
    return "\n\n".join(line for line in lines if line) + "\n"


def _title(name: str) -> str:
    return LIBRARY[name].title if name in LIBRARY else name.replace("_", " ")


def _look(name: str) -> str:
    if name not in LIBRARY:
        return "Not in the diagnosis' library."
    entry = LIBRARY[name]
    channels = ", ".join(CHANNEL_TITLES[c] for c in entry.channels)
    others = ", ".join(f"[{_title(n)}](#{n})" for n in entry.confused_with) or "nothing"
    looks = " ".join(plain(entry.__doc__ or "").split())
    told = f"*Looks like*: {looks} *Shows in*: {channels}.\n\n*Confused with*: {others}."
    return f"{told} *Told apart by*: {entry.split_by.text}"
