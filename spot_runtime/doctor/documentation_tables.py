"""Tables of the documentation, made from the code that they describe."""

from __future__ import annotations

import inspect

from spot_runtime.hal import errors
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import stops_table


def errors_table() -> str:
    """Every reason for which a run does not begin, as a Markdown table."""
    lines = ["| reason | exit code | meaning |", "|---|---|---|"]
    for _, kind in inspect.getmembers(errors, inspect.isclass):
        if issubclass(kind, errors.HalError) and kind is not errors.HalError:
            lines.append(f"| `{kind.label}` | {kind.exit_code} | {(kind.__doc__ or '').strip()} |")
    return "\n".join([*lines[:2], *sorted(lines[2:], key=lambda line: line.split("|")[2])])


def limits_table() -> str:
    """Every bound of the safety core with its default, as a Markdown table."""
    lines = ["| key | default | meaning |", "|---|---|---|"]
    for name, field in SafetyLimits.model_fields.items():
        default = f"{field.default:g}" if isinstance(field.default, (int, float)) else f"{field.default}"
        lines.append(f"| `{name}` | {default} | {field.description or ''} |")
    return "\n".join(lines)


def with_tables(text: str) -> str:
    """A document with its tables as they should be now, between the markers of each."""
    for name, table in (("stops", stops_table()), ("errors", errors_table()), ("limits", limits_table())):
        begin, end = f"<!-- {name}: written by scripts/write_runtime_tables.py -->", f"<!-- end of {name} -->"
        head, _, rest = text.partition(begin)
        _, _, tail = rest.partition(end)
        text = f"{head}{begin}\n\n{table}\n\n{end}{tail}"
    return text
