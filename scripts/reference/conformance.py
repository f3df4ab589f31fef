"""docs/conformance.md: what a robot may refuse."""

from __future__ import annotations

from fake_robot.conformance.table import markdown

from .words import page

ABOUT = """\
Every check that the fake robot makes of a client, and every answer that a client may rely on, with how we know it. The
fake refuses whatever the protos say that a robot may refuse; where nobody outside the vendor knows, the row is *our
guess*, and the last column names the key of the [scenario](scenario.md) that changes the fake's answer.

The same table runs against any server that claims to be a Spot:

```sh
spot-rl fake-robot exec -- spot-rl fake-robot conformance --robot HOST
```

It logs in with `BOSDYN_CLIENT_USERNAME` and `BOSDYN_CLIENT_PASSWORD`, moves nothing, and never takes a lease that
somebody holds. `--with-motion` also powers the motors, stands, walks half a metre and sits. A host that may be a real
robot needs `--i-stand-beside-it`: stand beside it with its e-stop in your hand. The exit code is 1 if a rule that is
documented or measured is broken; a guess that the server does not share *differs*."""


def conformance_page() -> str:
    """The page."""
    return page("What a robot may refuse", ABOUT, [markdown()])
