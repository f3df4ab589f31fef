"""docs/reference/scenario.md: every key of a fake robot's scenario."""

from __future__ import annotations

from fake_robot.scenario.scenario import Scenario, shipped_names
from spot_model.plant.delay import ConstantDelay, EmpiricalDelay, GammaDelay, LogNormalDelay

from .words import keys_table, page, sections

ABOUT = """\
A scenario describes one fake robot: its hidden [effects](effects.md) (`model`), ground, payload, network,
sensors, clock, battery, and what it refuses. It is a YAML file, for the option `--scenario FILE` of
`spot-rl fake-robot`. All keys are optional; unknown keys are refused.

```yaml
schema: spot-rl/scenario/1
terrain: {friction: 0.4}
payload: {mass_kg: 5}
```"""

DELAYS = """\
## Delays

The key `delay` of a channel takes one of these kinds, such as `{kind: constant, delay_s: 0.005}`.
"""


def scenario_page() -> str:
    """The page."""
    shipped = ", ".join(f"`{name}`" for name in shipped_names())
    return page(
        "The fake robot's scenario",
        f"{ABOUT}\n\n`--scenario NAME` selects a built-in one: {shipped}.",
        [
            *sections(Scenario),
            DELAYS,
            *(
                f"### {kind.model_fields['kind'].default}\n\n{kind.__doc__}\n\n{keys_table(kind)}"
                for kind in (ConstantDelay, LogNormalDelay, GammaDelay, EmpiricalDelay)
            ),
        ],
    )
