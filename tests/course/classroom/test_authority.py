"""A lab's certificates: the server's is signed by the authority's, and its fingerprint pins it."""

import datetime
import ssl
import stat
import sys

import pytest

from taskrpc.core.security.tls import Tls, pinned_context
from taskrpc.course.classroom import authority
from taskrpc.errors import TaskRpcError

NOW = datetime.datetime.now(datetime.UTC)
NAMES = ["lab.example", "192.168.1.20", "::1"]


def shaken(server: ssl.SSLContext, client: ssl.SSLContext, host: str) -> bytes:
    """The certificate (DER) that a client accepts in a handshake without any network."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(to_client, to_server, server_hostname=host)
    theirs = server.wrap_bio(to_server, to_client, server_side=True)
    for _ in range(4):
        for end in (ours, theirs):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
    return ours.getpeercert(binary_form=True)


@pytest.mark.parametrize("host", NAMES)
def test_client_that_trusts_the_authority_reaches_the_server_by_each_name(tmp_path, host):
    made = authority.make_certificates(tmp_path, NAMES, NOW)
    server, client = Tls(cert=made.cert, key=made.key), Tls(ca=made.ca)
    assert shaken(server.server_context(), client.client_context(), host)


def test_another_name_is_refused(tmp_path):
    made = authority.make_certificates(tmp_path, NAMES, NOW)
    server, client = Tls(cert=made.cert, key=made.key), Tls(ca=made.ca)
    with pytest.raises(ssl.SSLCertVerificationError, match="Hostname mismatch"):
        shaken(server.server_context(), client.client_context(), "other.example")


def test_fingerprint_is_that_of_the_shown_certificate_and_pins_it(tmp_path):
    made = authority.make_certificates(tmp_path, NAMES, NOW)
    server = Tls(cert=made.cert, key=made.key).server_context()
    shown = shaken(server, Tls(ca=made.ca).client_context(), NAMES[0])
    pem = ssl.DER_cert_to_PEM_cert(shown)
    assert authority.fingerprint(pem) == made.fingerprint
    # Under any name: it is the certificate itself that counts.
    assert shaken(server, pinned_context(pem, None), "elsewhere.example") == shown


def test_renewed_certificate_has_the_same_authority(tmp_path):
    made = authority.make_certificates(tmp_path, NAMES, NOW)
    before, ca = made.fingerprint, made.ca.read_bytes()
    again = authority.make_certificates(tmp_path, NAMES, NOW)
    assert again.fingerprint != before
    assert again.ca.read_bytes() == ca


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps them in the user's profile")
def test_only_this_user_can_read_the_keys(tmp_path):
    made = authority.make_certificates(tmp_path, NAMES, NOW)
    for path in (made.key, made.ca_key):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_invalid_authority_file_is_reported(tmp_path):
    made = authority.make_certificates(tmp_path, NAMES, NOW)
    made.ca_key.write_text("no key")
    with pytest.raises(TaskRpcError, match=r"ca\.pem, ca\.key: expected a certificate and its key"):
        authority.make_certificates(tmp_path, NAMES, NOW)


def test_missing_library_is_reported_with_the_pip_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    message = r"needs the library cryptography: pip install cryptography"
    with pytest.raises(TaskRpcError, match=message):
        authority.make_certificates(tmp_path, NAMES, NOW)
