"""The dependency audit that needs no network, and the bill of materials.

python scripts/audit.py               check; exit 1 and say what is wrong
python scripts/audit.py --sbom FILE   also write a CycloneDX 1.6 bill of materials
python scripts/audit.py --advisories  also ask for advisories of known holes: needs a network, and pip-audit

Checked: every requirement of pyproject.toml is an exact pin of an index package; every installed package is the locked
version; every wheel of the deployed runtime has a recorded SHA-256; every licence is one that this project accepts.
Not checked unless asked for: advisories of known holes. That needs a service on the network; the last line says so.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from importlib.metadata import PackageMetadata, distributions
from pathlib import Path

import tomllib
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parent.parent
LOCK = REPOSITORY / "requirements.lock"
HASHES = REPOSITORY / "deploy" / "hashes"
OWN = {"spot-rl"}
TOOLS = {"pip"}

LICENCES = re.compile(
    r"^(0BSD|Apache.*|BSD.*|3-Clause BSD.*|BSL-1\.0|CC0-1\.0|ISC.*|LLVM-exception|MIT.*|MPL-2\.0|Mozilla.*|"
    r"PSF-2\.0|Python Software Foundation.*|Zlib|Unlicense.*)$"
)
KNOWN = {
    # Read by a person, because their metadata name none that a program can judge.
    "apsw": "any OSI-approved licence, at the user's choice",
    "atheris": "Apache-2.0",
    "bosdyn-api": "Boston Dynamics SDK licence: used, never redistributed",
    "bosdyn-client": "Boston Dynamics SDK licence: used, never redistributed",
    "bosdyn-core": "Boston Dynamics SDK licence: used, never redistributed",
    "pytest-timeout": "MIT",
    "imageio-ffmpeg": "BSD-2-Clause; the ffmpeg program that it carries is GPL-3.0, run as a process of its own",
    "pygame": "LGPL-2.1: an optional package of its own",
}


def normal(name: str) -> str:
    """A package's normalised name."""
    return re.sub(r"[-_.]+", "-", name).lower()


def locked() -> dict[str, set[str]]:
    """The versions that the lock allows, by name."""
    versions: dict[str, set[str]] = {}
    for line in LOCK.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            requirement = Requirement(line)
            versions.setdefault(normal(requirement.name), set()).update(s.version for s in requirement.specifier)
    return versions


def digests() -> dict[tuple[str, str], list[str]]:
    """Recorded SHA-256 of wheels, by name and version."""
    found: dict[tuple[str, str], list[str]] = {}
    for file in sorted(HASHES.glob("*.txt")):
        text = file.read_text(encoding="utf-8").replace("\\\n", " ")
        for name, version, rest in re.findall(r"^([A-Za-z0-9_.-]+)==(\S+)(.*)$", text, re.MULTILINE):
            found.setdefault((normal(name), version), []).extend(re.findall(r"sha256:([0-9a-f]{64})", rest))
    return found


def licence_of(metadata: PackageMetadata) -> str:
    """What a package's metadata say."""
    stated = metadata.get("License-Expression")
    if stated:
        return str(stated)
    classifiers = [c.split(" :: ")[-1] for c in metadata.get_all("Classifier") or [] if c.startswith("License")]
    return " OR ".join(classifiers) or str(metadata.get("License") or "").split("\n")[0]


def is_accepted(licence: str) -> bool:
    """Whether every part of a licence expression is on the list."""
    parts = [part.strip(" ()") for part in re.split(r" AND | OR | WITH ", licence)]
    return all(LICENCES.match(part) for part in parts)


def loose_requirements() -> list[str]:
    """Requirements that are no exact pin of a package of an index."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    problems = []
    for line in (line for group in groups for line in group):
        requirement = Requirement(line)
        operators = [specifier.operator for specifier in requirement.specifier]
        if requirement.url or (operators != ["=="] and normal(requirement.name) not in OWN):
            problems.append(f"pyproject.toml: {line!r} is no exact pin")
    return problems


def problems_of_installed() -> list[str]:
    """Packages here that are not as locked, or under a licence that nobody has accepted."""
    allowed, problems = locked(), []
    for distribution in distributions():
        name, version = normal(distribution.metadata["Name"]), distribution.version.partition("+")[0]
        # What is not locked is not this project's: somebody's own tool in the same environment.
        if name in OWN | TOOLS or name not in allowed:
            continue
        if version not in allowed[name]:
            problems.append(f"{name} {version} is installed; locked: {' or '.join(sorted(allowed[name]))}")
        licence = licence_of(distribution.metadata)
        if name not in KNOWN and not is_accepted(licence):
            problems.append(
                f"{name} {version}: licence {licence!r} is not accepted; read it, then enter it in audit.py"
            )
    return problems


def unhashed() -> list[str]:
    """Packages of the deployed runtime without a recorded digest."""
    recorded, allowed = digests(), locked()
    problems = [f"deploy/hashes: {name}=={version} has no digest" for (name, version), h in recorded.items() if not h]
    for name, version in recorded:
        if name not in TOOLS and version not in allowed.get(name, set()):
            problems.append(f"deploy/hashes: {name}=={version} is not the locked version")
    return problems


def bill_of_materials() -> dict[str, object]:
    """Everything that is installed here, as CycloneDX; the same every time for the same packages."""
    recorded, components = digests(), []
    for distribution in sorted(distributions(), key=lambda d: normal(d.metadata["Name"])):
        name, version = normal(distribution.metadata["Name"]), distribution.version
        if name in OWN:
            continue
        component: dict[str, object] = {
            "type": "library",
            "bom-ref": f"pkg:pypi/{name}@{version}",
            "name": name,
            "version": version,
            "purl": f"pkg:pypi/{name}@{version}",
            "licenses": [{"license": {"name": KNOWN.get(name) or licence_of(distribution.metadata) or "unknown"}}],
        }
        found = recorded.get((name, version), [])
        if found:
            component["properties"] = [{"name": "spot-rl:wheel-sha256", "value": digest} for digest in sorted(found)]
        components.append(component)
    own = {"type": "application", "bom-ref": "spot-rl", "name": "spot-rl"}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": own},
        "components": components,
        "dependencies": [{"ref": "spot-rl", "dependsOn": [str(component["bom-ref"]) for component in components]}],
    }


ASKED = "audit: no advisory names a locked version"
NOT_ASKED = (
    "audit: advisories of known holes were NOT checked: that needs a network; before a release, with pip-audit "
    "installed: make audit ARGS=--advisories"
)


def known_holes() -> list[str]:
    """What pip-audit says of the lock; that it cannot be asked is a problem, too."""
    command = [sys.executable, "-m", "pip_audit", "--requirement", str(LOCK), "--no-deps", "--disable-pip", "--strict"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "No module named" in done.stderr:
        return ["advisories could not be checked: pip-audit is not installed; python -m pip install pip-audit"]
    said = (done.stdout + done.stderr).strip()
    return [f"advisories, as pip-audit says (no network is one reason):\n{said[-4000:]}"] if done.returncode else []


def main() -> None:
    """Audit, and write the bill where it is wanted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sbom", type=Path, help="where to write the bill of materials")
    parser.add_argument("--advisories", action="store_true", help="also ask for advisories; needs a network")
    options = parser.parse_args()
    problems = [*loose_requirements(), *problems_of_installed(), *unhashed()]
    if options.advisories:
        problems += known_holes()
    if options.sbom is not None:
        options.sbom.parent.mkdir(parents=True, exist_ok=True)
        options.sbom.write_text(json.dumps(bill_of_materials(), indent=1) + "\n", encoding="utf-8")
    if problems:
        sys.exit("\n".join(problems))
    print(
        f"audit: {len(locked())} packages locked, licences accepted, {len(digests())} packages with digests of wheels"
    )
    print(ASKED if options.advisories else NOT_ASKED)


if __name__ == "__main__":
    main()
