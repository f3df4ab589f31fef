"""docs/reference/training-config.md: every key of a training config, and every reward."""

from __future__ import annotations

from trainer.config.task_config import RewardWeights
from trainer.config.train_config import TrainConfig
from trainer.task.rewards import TERMS

from .words import keys_table, page, parts_of, plain, table

ABOUT = """\
`spot-rl train --config FILE`, and `--set key.path=value` for single keys; the prefix `task.` may be omitted:
`--set rewards.gait=10`. The whole config, defaults included, is written into the run folder.

```yaml
schema: spot-rl/train/1
name: mine
iterations: 300
n_envs: 1024
task:
  commands: {v_x_m_s: [-1.0, 2.0]}
  rewards: {gait: 10.0}
```"""


def training_page() -> str:
    """The page."""
    weights = RewardWeights().model_dump()
    rewards = [
        (f"`{name}`", f"{weights[name]:g}", plain(term.__doc__ or "").partition("\n")[0])
        for name, term in TERMS.items()
    ]
    parts = [keys_table(TrainConfig)]
    for path, part in parts_of(TrainConfig):
        if part is RewardWeights:
            parts += [
                (
                    f"## {path}\n\nWeights of the rewards, each a term of the sum over one policy period. "
                    "Formulas: `trainer/task/rewards.py`; shared: [task.reward_shape](#taskreward_shape).\n"
                ),
                table(("reward", "weight", "what is rewarded or penalised"), rewards),
            ]
        else:
            parts += [f"## {path}\n\n{plain(part.__doc__ or '')}\n", keys_table(part)]
    return page("Training config", ABOUT, parts)
