"""docs/reference/files.md: the small files that a user writes, key by key."""

from __future__ import annotations

from spot_model.io.model_file import BUILT_IN, ModelFileData
from spot_model.io.models_file import ModelsFileData
from spot_model.io.velocity_sequence import BUILT_IN as SEQUENCES
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.card import PolicyCard
from trainer.sysid.config import SysidConfig

from .words import keys_table, page, sections

ABOUT = """\
These are YAML files with their `schema` in the first line. An unknown key is refused with a list of the allowed ones.
[Run configurations](config.md), [scenarios](scenario.md) and [training configs](training-config.md) have their
own pages."""


def files_page() -> str:
    """The page."""
    return page(
        "Model, sequence and search files",
        ABOUT,
        [
            (
                "## Model file\n\nA simulated Spot: a list of [effects](effects.md) with joints and values. Wherever "
                f"a model is asked for (`--nominal`, `--model`, `model:`), a built-in name does: {_names(BUILT_IN)}.\n"
            ),
            (
                "```yaml\nschema: spot-rl/model/1\neffects:\n"
                "  - {effect: coulomb_friction, joints: [knees], level_nm: 0.18}\n"
                "  - {effect: command_delay, delay_s: 0.005}\n```\n"
            ),
            keys_table(ModelFileData),
            (
                "### Models file\n\nSeveral models in one file, for `train`, `evaluate` and `refine`: the fitted robot "
                "first, then others that its logs allow. Simulated robot i is of model i modulo their number.\n"
            ),
            keys_table(ModelsFileData),
            (
                "## Velocity sequence\n\nVelocity commands over time, for `--sequence FILE`. Built in: "
                f"{_names(SEQUENCES)}.\n"
            ),
            (
                "```yaml\nschema: spot-rl/velocity-sequence/1\nname: ahead\nduration_s: 5\nwaypoints:\n"
                "  - {time_s: 0, v_x_m_s: 0.5}\n"
                "  - {time_s: 2, v_x_m_s: 1.5, ramp: true}\n```\n"
            ),
            *sections(VelocitySequence, "###"),
            "## Search of an identification\n\n`spot-rl sysid --config FILE`; without it, the paper's parameters.\n",
            *sections(SysidConfig, "###"),
            "## Policy card\n\n`NAME.card.yaml` beside `NAME.onnx`, written by `spot-rl policy card`.\n",
            keys_table(PolicyCard),
        ],
    )


def _names(names: object) -> str:
    return ", ".join(f"`{name}`" for name in names)  # type: ignore[attr-defined]
