"""docs/reference/mapping.md: every key of the mapping with which a recording is imported."""

from __future__ import annotations

from spot_log.importing.mapping import OTHER, PER_JOINT, Mapping, SignalMapping, TimeMapping, record_of, shipped_names
from spot_log.importing.recording import UNITS

from .words import keys_table, page, plain, table

ABOUT = """\
A mapping says which array or column of a recording is which signal. It gives units (degrees or radians), the order of
joints and of a quaternion (wxyz or xyzw), and the clock. `spot-rl log import MAPPING FILE --out LOG.mcap` reads it. The
recording is a CSV file (commas, semicolons or tabs; decimal commas), NPZ, Parquet, HDF5, or a ROS 2 bag.
`spot-rl log import --suggest FILE` writes a mapping to start from. Whole examples, by name in place of a file: {names}.

```yaml
schema: spot-rl/import/1
joint_names: [hip, knee]
foot_names: []
source_joint_names: [knee, hip]
time: {{from: t, unit: ms}}
signals:
  position: {{from: dof_pos, unit: deg}}
  load: {{from: "tau_{{joint}}", unit: N·m}}
  odom_from_body: {{from: quat, order: xyzw}}
```"""

DOUBTS = """\
## What is checked

| signals | held against | refused where |
|---|---|---|
| `position` | Spot's joint stops | more than 5 % of a joint's rows are beyond them |
| `velocity` | the change of `position` | its sign is opposite, its joints are exchanged, or another unit fits |
| `load` | `kp`, `kd` and the set-points: the servo's law | as for `velocity` |
| `setpoint_position` | `position` | as for `velocity` |
| `odom_from_body` | gravity, turn rate, travel | another order or its inverse fits |
| `time` | its usual step | never |
| all | blanks | a signal has no number at all |

Anything else that does not fit is a warning. The log holds it as an event `import_doubted`, and its page says *Import
doubted* instead of *No fault*. `accept_doubts: true` writes a log that is refused otherwise.
"""

BAGS = """\
## ROS 2 bags

FILE is the bag's folder, or one `.db3` or `.mcap` file; the extra `ros` is needed. Fields are named `TOPIC.field`:

| message | names |
|---|---|
| `sensor_msgs/JointState` | `/joint_states.position.NAME`, `.velocity.NAME`, `.effort.NAME`: joints by name |
| `nav_msgs/Odometry` | `/odom.pose.pose.position`, `.pose.pose.orientation` (xyzw), `.twist.twist.linear` and others |
| `sensor_msgs/Imu` | `/imu.linear_acceleration`, `/imu.angular_velocity`, `/imu.orientation` |
| `geometry_msgs/Twist` | `/cmd_vel.linear.x`, `.linear.y`, `.angular.z`; `TwistStamped`: `/cmd_vel.twist.linear.x` |
| `std_msgs/Float64MultiArray` | `/NAME.data`, all columns in their order |

Other messages work the same way. `TOPIC.stamp` is the header's stamp, `TOPIC.time` the receipt, in ns. The topic of
`time` gives the rows. Other topics of the state keep their last value for ten of their usual steps; commands and ticks
come once a message.
"""


def mapping_page() -> str:
    """The page."""
    signals = [
        (f"`{name}`", quantity, f"{width}" if width else "any", record_of(name), ", ".join(UNITS[quantity]))
        for name, quantity, width in [
            *((name, quantity, "joints") for name, quantity in PER_JOINT.items()),
            *((name, quantity, width) for name, (quantity, width) in OTHER.items()),
        ]
    ]
    return page(
        "Mapping of an import",
        ABOUT.format(names=", ".join(f"`{name}`" for name in shipped_names())),
        [
            keys_table(Mapping),
            f"## time\n\n{plain(TimeMapping.__doc__ or '')}\n",
            keys_table(TimeMapping),
            f"## signals\n\n{plain(SignalMapping.__doc__ or '')}\n",
            keys_table(SignalMapping),
            "### Names, quantities and units\n\n`position` is needed. The log has the first unit of each row.\n",
            table(("signal", "quantity", "columns", "record", "units"), signals),
            DOUBTS,
            BAGS,
        ],
    )
