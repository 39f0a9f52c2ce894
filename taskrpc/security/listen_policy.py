"""Where a server may listen: beyond this machine only with a certificate, and asking for proof."""

from __future__ import annotations

from taskrpc.errors import CannotListen
from taskrpc.security.roles import MIN_SECRET, Accounts


def refuse_exposure(
    host: str, *, certificate: bool, token: str, accounts: Accounts | None, ca: bool
) -> None:
    """Check that a server is protected well enough to listen where other machines reach it.

    `ca` says that callers must show certificates. Raises CannotListen.
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
    for what, secret in secrets.items():
        if len(secret) < MIN_SECRET:
            raise CannotListen(
                f"cannot listen at {host}: {what} has {len(secret)} characters; where other"
                f" machines can try to guess it, at least {MIN_SECRET} are needed"
            )
