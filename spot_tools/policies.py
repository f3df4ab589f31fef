"""Look at policies, sign them, and check signatures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import PolicyArgument
from spot_model.errors import BadInputError
from spot_model.text import plain


def show(policy: PolicyArgument) -> None:
    """Check a policy file, and print its card: speeds, gait, gains, training, what it was tried on."""
    from spot_model.policy.card import card_lines, load_card
    from spot_model.policy.contract import gait_sentence
    from spot_model.policy.policy import load_policy
    from spot_model.policy.signature import signature_path

    loaded = load_policy(policy)
    for line in card_lines(loaded, load_card(policy)):
        typer.echo(plain(line))
    typer.echo(plain(gait_sentence(loaded.contract)))
    typer.echo("signature file found" if signature_path(policy).exists() else "no signature file")


def card(
    policy: PolicyArgument,
    evaluation: Annotated[Path, typer.Argument(help="evaluation.json of 'spot-rl evaluate' of that file.")],
    about: Annotated[str, typer.Option(help="Description in one line.")] = "",
    gait: Annotated[str, typer.Option(help="Its gait: trot, bound, ...")] = "",
    tried_on: Annotated[list[str] | None, typer.Option(help="Robot or ground that it walked on; repeatable.")] = None,
    not_tried_on: Annotated[
        list[str] | None, typer.Option(help="Robot or ground that it was not tried on; repeatable.")
    ] = None,
) -> None:
    """Write a policy's card beside it, with the figures of its evaluation."""
    from spot_model.policy.card import card_of, write_card
    from spot_model.policy.policy import load_policy

    made = card_of(
        load_policy(policy),
        evaluation,
        about=about,
        gait=gait,
        tried_on=tried_on or (),
        not_tried_on=not_tried_on or (),
    )
    typer.echo(write_card(policy, made))


def key(
    private: Annotated[Path, typer.Argument(help="File for the private key; keep it off the robots.")],
    public: Annotated[Path, typer.Argument(help="File for the public key; name it in service.policy_public_key.")],
) -> None:
    """Make a pair of Ed25519 keys."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat

    from spot_model.io.whole import check_new, whole_file

    check_new(private, public)
    if private.resolve() == public.resolve():
        raise BadInputError(f"{private} is named twice; give one file for the private key and one for the public one")
    made = Ed25519PrivateKey.generate()
    with whole_file(public) as public_part, whole_file(private) as private_part:
        private_part.touch(mode=0o600)
        private_part.write_bytes(made.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
        public_part.write_bytes(made.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    typer.echo(f"{private} signs; name {public} in service.policy_public_key of the robots that shall trust it")


def sign(
    policy: PolicyArgument,
    key: Annotated[Path, typer.Option(help="The private key.")],  # noqa: A002, RUF100 - the option's name
) -> None:
    """Write a signature beside a policy; an older one is replaced."""
    from spot_model.io.whole import whole_file
    from spot_model.policy.policy import load_policy
    from spot_model.policy.signature import private_key, signature_path, signed_line

    loaded = load_policy(policy)
    path = signature_path(policy)
    signature = private_key(key).sign(signed_line(loaded.sha256))
    with whole_file(path, replace=True) as part:
        part.write_bytes(signature)
    typer.echo(plain(f"{path}: {loaded.contract.name}, SHA-256 {loaded.sha256}"))


def verify(
    policy: PolicyArgument, public_key: Annotated[Path, typer.Option(help="PEM file of the keys that are trusted.")]
) -> None:
    """Check a policy's signature; exit code 3 if it is not valid."""
    from spot_model.policy.policy import load_policy
    from spot_model.policy.signature import check_signature

    loaded = load_policy(policy, admit=lambda sha256: check_signature(policy, sha256, public_key))
    typer.echo(plain(f"{policy} is signed: {loaded.contract.name}, SHA-256 {loaded.sha256}"))
