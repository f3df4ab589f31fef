"""How an unmodified SDK program reaches the fake: the host argument, the environment, and trust in its certificate.

The SDK trusts the vendor's certificate unless a program passes ``cert_resource_glob``. A ``sitecustomize`` module,
which Python imports at start, adds the fake's authority to what the SDK trusts; the program and the SDK stay as they
are.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from fake_robot.start.certificates import CertificateError, write_private

CA_VARIABLE = "SPOT_RL_CA_FILE"

_SITECUSTOMIZE = '''\
"""Written by `spot-rl fake-robot`: lets an unmodified bosdyn-client program trust the fake robot.

Adds one certificate authority to the one that the SDK trusts: the file SPOT_RL_CA_FILE, else the one named below.
"""

import os
import sys
from importlib.machinery import PathFinder

CA_FILE = os.environ.get("SPOT_RL_CA_FILE") or {ca_file!r}
SDK_MODULE = "bosdyn.client.sdk"


class _TrustingFinder:
    """Finds the SDK's module as Python would, and adds to what it does once it is loaded."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name != SDK_MODULE:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module

            def exec_module(module):
                run(module)
                _trust_also(module.Sdk)

            spec.loader.exec_module = exec_module
        return spec


def _trust_also(sdk_class):
    load = sdk_class.load_robot_cert

    def load_robot_cert(self, resource_path_glob=None):
        load(self, resource_path_glob)
        if resource_path_glob is None:
            with open(CA_FILE, "rb") as file:
                self.cert += b"\\n" + file.read()

    sdk_class.load_robot_cert = load_robot_cert


def _run_the_next_sitecustomize():
    """Python imports one sitecustomize only; run the one that this file hides."""
    here = os.path.dirname(os.path.abspath(__file__))
    rest = [folder for folder in sys.path if os.path.abspath(folder or os.curdir) != here]
    spec = PathFinder.find_spec("sitecustomize", rest)
    if spec is not None and spec.loader is not None:
        import importlib.util

        spec.loader.exec_module(importlib.util.module_from_spec(spec))


sys.meta_path.insert(0, _TrustingFinder)
_run_the_next_sitecustomize()
'''


@dataclass(frozen=True)
class SdkEnvironment:
    """What to put into the environment of a program, and the certificate that it comes to trust."""

    ca_path: Path
    sdk_folder: Path
    username: str
    password: str

    def in_front_of(self, python_path: str) -> str:
        """A value of PYTHONPATH that leads to the trust, then where this one leads; an empty one leads nowhere."""
        return os.pathsep.join(filter(None, [str(self.sdk_folder), python_path]))

    def variables(self, base: dict[str, str] | None = None) -> dict[str, str]:
        """The variables, with ``PYTHONPATH`` in front of the one in ``base`` (the process's own by default)."""
        inherited = (os.environ if base is None else base).get("PYTHONPATH", "")
        return {
            "PYTHONPATH": self.in_front_of(inherited),
            CA_VARIABLE: str(self.ca_path),
            "BOSDYN_CLIENT_USERNAME": self.username,
            "BOSDYN_CLIENT_PASSWORD": self.password,
        }


def write_sdk_folder(state_folder: Path, ca_path: Path) -> Path:
    """Write the folder with the ``sitecustomize`` module; returns the folder. Raises CertificateError."""
    folder = state_folder / "sdk"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_private(folder / "sitecustomize.py", _SITECUSTOMIZE.format(ca_file=str(ca_path.absolute())).encode())
    except OSError as error:
        raise CertificateError(f"the folder {folder} cannot be written: {error}; choose --state-dir") from error
    return folder
