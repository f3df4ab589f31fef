"""Signatures of policies: which file runs is decided by whoever holds the key, before the file is used."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import typer
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat, PublicFormat
from typer.testing import CliRunner

import spot_model.policy.policy
from spot_model.io.whole import OutputExistsError
from spot_model.policy.contract import PolicyError
from spot_model.policy.policy import load_policy
from spot_model.policy.signature import check_signature, private_key, public_keys, signature_path, signed_line
from spot_runtime.admission import admission
from spot_runtime.config import RunConfig, ServiceConfig
from spot_runtime.operator.door.access import Refusal
from spot_runtime.operator.run.run_spec import load_checked
from spot_runtime.operator.server.policy_folder import PolicyFolder
from spot_tools.policies import key, show, sign, verify

app = typer.Typer()
for command in (show, key, sign, verify):
    app.command()(command)

SHIPPED = Path(__file__).resolve().parents[2] / "policies" / "walk.onnx"


@pytest.fixture
def signed(tmp_path: Path) -> tuple[Path, Path, Path]:
    """A policy that is signed, the private key, the public key."""
    policy, private, public = tmp_path / "walk.onnx", tmp_path / "private.pem", tmp_path / "public.pem"
    shutil.copyfile(SHIPPED, policy)
    assert CliRunner().invoke(app, ["key", str(private), str(public)]).exit_code == 0
    assert CliRunner().invoke(app, ["sign", str(policy), "--key", str(private)]).exit_code == 0
    return policy, private, public


def test_a_signed_policy_is_taken_and_a_changed_one_is_not(signed: tuple[Path, Path, Path]) -> None:
    policy, _, public = signed
    admit = admission(ServiceConfig(policy_public_key=public), policy)
    assert load_policy(policy, admit=admit).contract.name == "walk"
    data = bytearray(policy.read_bytes())
    data[-1] ^= 1
    policy.write_bytes(data)
    with pytest.raises(PolicyError, match=r"walk\.onnx\.sig does not hold.*not the one that was signed"):
        load_policy(policy, admit=admit)


def test_the_signature_is_looked_at_before_native_code_sees_the_file(
    signed: tuple[Path, Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, _, public = signed
    signature_path(policy).unlink()
    seen: list[object] = []
    monkeypatch.setattr(spot_model.policy.policy, "policy_from_bytes", lambda *a, **_: seen.append(a))
    with pytest.raises(
        PolicyError, match=r"is not signed: .*policy_public_key asks for a signature: spot-rl policy sign"
    ):
        load_policy(policy, admit=admission(ServiceConfig(policy_public_key=public), policy))
    assert not seen


def test_any_key_of_the_file_counts_and_no_other(signed: tuple[Path, Path, Path], tmp_path: Path) -> None:
    policy, _, public = signed
    digest = load_policy(policy).sha256
    other_private, other = tmp_path / "other-private.pem", tmp_path / "other.pem"
    CliRunner().invoke(app, ["key", str(other_private), str(other)])
    with pytest.raises(PolicyError, match="somebody else signed it"):
        check_signature(policy, digest, other)
    both = tmp_path / "both.pem"
    both.write_bytes(other.read_bytes() + public.read_bytes())
    assert len(public_keys(both.read_bytes(), both)) == 2
    check_signature(policy, digest, both)
    with pytest.raises(PolicyError, match="does not hold"):
        check_signature(policy, "0" * 64, both)


@pytest.mark.parametrize("size", [0, 63, 65, 5_000_000])
def test_signatures_of_another_size_are_refused_in_words(signed: tuple[Path, Path, Path], size: int) -> None:
    policy, _, public = signed
    signature_path(policy).write_bytes(bytes(size))
    with pytest.raises(PolicyError, match=r"walk\.onnx\.sig"):
        check_signature(policy, load_policy(policy).sha256, public)


def test_key_files_that_cannot_be_trusted(signed: tuple[Path, Path, Path], tmp_path: Path) -> None:
    policy, private, public = signed
    digest = load_policy(policy).sha256
    public.chmod(0o666)
    with pytest.raises(PolicyError, match=f"open to others; run: chmod 644 {public}"):
        check_signature(policy, digest, public)
    private.chmod(0o640)
    with pytest.raises(PolicyError, match="chmod 600"):
        private_key(private)
    wrong = tmp_path / "wrong.pem"
    elliptic = ec.generate_private_key(ec.SECP256R1())
    for text, words in (
        (b"", "no public key in PEM"),
        (b"canary", "no public key in PEM"),
        (b"-----BEGIN PUBLIC KEY-----\ncanary\n-----END PUBLIC KEY-----\n", "no public key"),
        (elliptic.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo), "not Ed25519"),
        (b"x" * 70_000, "at most 65536 bytes"),
    ):
        wrong.write_bytes(text)
        with pytest.raises(PolicyError, match=words) as told:
            check_signature(policy, digest, wrong)
        assert "canary" not in str(told.value)
    with pytest.raises(PolicyError, match="cannot be read"):
        check_signature(policy, digest, tmp_path / "none.pem")
    with pytest.raises(PolicyError, match="no file of at most"):
        check_signature(policy, digest, Path(os.devnull))
    private.chmod(0o600)
    private.write_bytes(elliptic.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"word")))
    with pytest.raises(PolicyError, match="is encrypted"):
        private_key(private)
    private.write_bytes(b"-----BEGIN PRIVATE KEY-----\ncanary\n-----END PRIVATE KEY-----\n")
    with pytest.raises(PolicyError, match="is no private key") as told:
        private_key(private)
    assert "canary" not in str(told.value)


def test_keys_are_never_overwritten(signed: tuple[Path, Path, Path]) -> None:
    _, private, public = signed
    before = private.read_bytes()
    again = CliRunner().invoke(app, ["key", str(private), str(public)])
    assert isinstance(again.exception, OutputExistsError)
    assert "nothing is overwritten" in str(again.exception)
    assert private.read_bytes() == before
    assert private.stat().st_mode & 0o777 == 0o600


def test_the_shelf_and_the_control_process_ask_for_the_signature(signed: tuple[Path, Path, Path]) -> None:
    policy, _, public = signed
    config = ServiceConfig(policies=policy.parent, policy_public_key=public)
    found = PolicyFolder(config).find("walk", "")
    whole = RunConfig(service=config)
    assert load_checked(policy, found.sha256, whole).sha256 == found.sha256
    signature_path(policy).write_bytes(bytes(64))
    assert [p.is_allowed for p in PolicyFolder(config).list()] == [False]
    with pytest.raises(Refusal, match="does not hold"):
        PolicyFolder(config).find("walk", "")
    with pytest.raises(PolicyError, match="does not hold"):
        load_checked(policy, found.sha256, whole)
    with pytest.raises(PolicyError, match="replaced just now"):
        load_checked(policy, "0" * 64, whole)


def test_verify_and_show(signed: tuple[Path, Path, Path]) -> None:
    policy, _, public = signed
    assert "is signed: walk" in CliRunner().invoke(app, ["verify", str(policy), "--public-key", str(public)]).output
    assert "signature file found" in CliRunner().invoke(app, ["show", str(policy)]).output


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not here")
def test_openssl_makes_the_same_signature(signed: tuple[Path, Path, Path], tmp_path: Path) -> None:
    policy, private, _ = signed
    line, made = tmp_path / "line", tmp_path / "made"
    line.write_bytes(signed_line(load_policy(policy).sha256))
    command = ["openssl", "pkeyutl", "-sign", "-rawin", "-inkey", str(private), "-in", str(line), "-out", str(made)]
    subprocess.run(command, check=True, capture_output=True)
    assert made.read_bytes() == signature_path(policy).read_bytes()
