"""The rule for listening: other machines may reach a server only with encryption and accounts."""

from __future__ import annotations

from taskrpc.core.security.roles import MIN_SECRET, Accounts
from taskrpc.errors import CannotListen


def check_listen_policy(
    host: str, *, certificate: bool, token: str, accounts: Accounts | None, ca: bool
) -> None:
    """Check that a server is protected well enough for an address that other machines can reach.

    It needs a certificate, and a way to authenticate its callers: a token, accounts, or `ca`
    (callers must show certificates). Raises CannotListen.
    """
    if not (certificate and (token or ca or accounts is not None)):
        raise CannotListen(
            f"cannot listen at {host}: beyond this machine's own addresses (127.0.0.1,"
            " localhost, ::1) a server needs a certificate (--tls-cert and --tls-key, or"
            " tls=taskrpc.Tls(cert, key)) and one of: a token (--token-file, token=), accounts"
            " (--accounts, accounts=), or an authority for its callers' certificates (--tls-ca,"
            " Tls(ca=))"
        )
    secrets = {"the token": token} if token else {}
    for account in accounts or ():
        secrets[f"the secret of the account {account.name}"] = account.secret
    for description, secret in secrets.items():
        if len(secret) < MIN_SECRET:
            raise CannotListen(
                f"cannot listen at {host}: {description} has {len(secret)} characters; expected at"
                f" least {MIN_SECRET}, because other machines can try to guess it"
            )
