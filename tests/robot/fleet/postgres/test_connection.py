import asyncio
import os

import pytest

from taskrpc.errors import StoreError, TaskRpcError

pytest.importorskip("psycopg")

from taskrpc.robot.fleet.postgres.connection import DatabaseUrl, answered, close
from taskrpc.robot.fleet.postgres.store import PostgresStore

SECRET = "s3cret-word"


def test_url_is_shown_without_its_password():
    url = DatabaseUrl(f"postgresql://ann:{SECRET}@db.lab:5433/fleet?sslmode=require")
    assert str(url) == "postgresql://ann@db.lab:5433/fleet"
    assert url.without_password(f"…{SECRET}…") == "…***…"


@pytest.mark.parametrize(
    "url",
    [
        f"postgresql://ann:{SECRET}@db.lab:no_port/fleet?x=y",
        f"postgresql://ann:{SECRET}@[db.lab/fleet",
        f"postgresql://ann:{SECRET}%zz@db.lab/fleet",
    ],
)
def test_invalid_url_is_explained_without_its_password(url):
    with pytest.raises(TaskRpcError, match="--db: expected a URL such as postgresql://") as caught:
        DatabaseUrl(url)
    assert SECRET not in str(caught.value)


@pytest.mark.parametrize(
    "password", [f"a@{SECRET}", f"a/{SECRET}", f"a:b@{SECRET}/c", f"{SECRET}/a"]
)
def test_unquoted_sign_in_the_password_is_explained_without_the_password(password):
    with pytest.raises(TaskRpcError, match="write / as %2F and @ as %40 in it") as caught:
        DatabaseUrl(f"postgresql://ann:{password}@db.lab/fleet")
    assert SECRET not in str(caught.value)


@pytest.fixture
def environment(monkeypatch):
    """Returns a function that sets libpq's variables; all others are unset."""
    for name in [each for each in os.environ if each.startswith("PG")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PGUSER", "ann")

    def change(**values):
        for name, value in values.items():
            monkeypatch.setenv(name, str(value))

    return change


def test_url_is_shown_with_the_host_that_the_environment_names(environment):
    environment(PGHOST="db.lab", PGPORT="6000", PGDATABASE="robots", PGPASSWORD=SECRET)
    url = DatabaseUrl("postgresql://")
    assert str(url) == "postgresql://ann@db.lab:6000/robots"
    assert not url.has_password  # nobody can read it in the arguments of a command
    assert url.without_password(SECRET) == "***"
    assert str(DatabaseUrl("postgresql://bob@other/fleet")) == "postgresql://bob@other:6000/fleet"


def test_url_is_shown_with_the_host_of_the_service_file(environment, tmp_path):
    services = tmp_path / "services"
    services.write_text(f"[lab]\nhost=db.lab\nport=6000\ndbname=fleet\npassword={SECRET}\n")
    environment(PGSERVICEFILE=services)
    for url in ("postgresql:///?service=lab", "postgresql://"):
        assert str(DatabaseUrl(url)) == "postgresql://ann@db.lab:6000/fleet"
        assert DatabaseUrl(url).without_password(SECRET) == "***"
        assert os.environ.get("PGSERVICE") in (None, "lab")
        environment(PGSERVICE="lab")
    assert str(DatabaseUrl("postgresql://1.2.3.4/x")) == "postgresql://ann@1.2.3.4:6000/x"


def test_all_hosts_of_a_url_are_shown(environment):
    url = DatabaseUrl("postgresql://a:1,b:2/fleet?target_session_attrs=read-write")
    assert str(url) == "postgresql://ann@a:1,b:2/fleet"
    assert (
        str(DatabaseUrl("postgresql:///fleet?host=a,b")) == "postgresql://ann@a:5432,b:5432/fleet"
    )


def test_local_socket_is_not_called_localhost(environment):
    assert str(DatabaseUrl("postgresql:///fleet")) == (
        "postgresql://ann@/fleet at the local socket, port 5432,"
    )
    assert str(DatabaseUrl("postgresql:///fleet?host=/run/x&port=6")) == (
        "postgresql://ann@/fleet at the local socket in /run/x, port 6,"
    )


def test_quoted_signs_in_the_url_are_accepted():
    url = DatabaseUrl("postgresql://ann:a%40b%2Fc@db.lab/fleet?application_name=x@y")
    assert url.has_password
    assert str(url) == "postgresql://ann@db.lab:5432/fleet"


@pytest.mark.postgres
@pytest.mark.real_time
async def test_user_without_rights_on_the_tables_is_told_what_to_do(own_cluster):
    own_cluster.execute("CREATE ROLE ann LOGIN")
    store = PostgresStore(own_cluster.url(), listen=False)
    await store.refresh()
    await store.close()
    reading = PostgresStore(own_cluster.url().replace("taskrpc@", "ann@"), listen=False)
    with pytest.raises(
        StoreError, match=r"permission denied .*; let the servers use the user that"
    ):
        await reading.refresh()
    await reading.close()


@pytest.mark.parametrize(
    ("reason", "advice"),
    [
        ('FATAL: no pg_hba.conf entry for host "::1"', "allow this user and this machine in"),
        ("server does not support SSL, but SSL was required", "set ssl = on in PostgreSQL, or"),
        ('invalid integer value "54x2" for connection option "port"', "correct the port in --db"),
        ('could not extend file "base/1": No space left on device', "free space on the disk of"),
        ("cannot execute UPDATE in a read-only transaction", "connect to the primary: add"),
        ('definition of service "lab" not found', "correct the service in --db or PGSERVICE"),
    ],
)
def test_error_says_what_to_do(reason, advice):
    error = DatabaseUrl("postgresql://ann@db.lab/fleet").error("cannot be used", OSError(reason))
    assert f"cannot be used: {reason}; {advice}" in str(error)


def test_question_of_libpq_is_left_out():
    asked = OSError("Connection refused\n\tIs the server running on that host and accepting TCP?")
    error = DatabaseUrl("postgresql://ann@db.lab/fleet").error("cannot be used", asked)
    assert "cannot be used: Connection refused; start PostgreSQL there" in str(error)


@pytest.mark.real_time
async def test_missing_server_is_named_with_what_to_do():
    url = DatabaseUrl(f"postgresql://ann:{SECRET}@127.0.0.1:1/fleet")
    with pytest.raises(StoreError) as caught:
        await url.connect("test")
    text = str(caught.value)
    assert text.startswith("postgresql://ann@127.0.0.1:1/fleet cannot be used: ")
    assert text.endswith("start PostgreSQL there, or correct the host and the port in --db")
    assert SECRET not in text
    assert "127.0.0.1" not in caught.value.for_callers


@pytest.mark.postgres
@pytest.mark.real_time
async def test_missing_database_is_named_with_what_to_do(shared_cluster):
    with pytest.raises(StoreError, match=r'database "nowhere" does not exist; create it with'):
        await DatabaseUrl(shared_cluster.url("nowhere")).connect("test")


@pytest.mark.postgres
@pytest.mark.real_time
async def test_wrong_password_is_never_shown(own_cluster):
    own_cluster.execute(f"CREATE ROLE ann LOGIN PASSWORD '{SECRET}'")
    rules = own_cluster.folder / "data" / "pg_hba.conf"
    rules.write_text("host all taskrpc all trust\nhost all ann all scram-sha-256\n")
    own_cluster.execute("SELECT pg_reload_conf()")
    right = own_cluster.url().replace("taskrpc@", f"ann:{SECRET}@")
    for _ in range(50):  # PostgreSQL reads the rules a moment later
        try:
            connection = await DatabaseUrl(right).connect("test")
            break
        except StoreError:
            await asyncio.sleep(0.1)
    await close(connection)
    wrong = own_cluster.url().replace("taskrpc@", "ann:wrong-word@")
    with pytest.raises(StoreError, match="password authentication failed") as caught:
        await DatabaseUrl(wrong).connect("test")
    assert "wrong-word" not in str(caught.value)
    assert "correct the user and the password" in str(caught.value)


@pytest.mark.postgres
@pytest.mark.real_time
async def test_connection_that_does_not_answer_is_cut(postgres_url, monkeypatch):
    monkeypatch.setattr("taskrpc.robot.fleet.postgres.connection.ANSWER_TIMEOUT", 0.2)
    connection = await DatabaseUrl(postgres_url).connect("test")
    with pytest.raises(Exception, match=r"closed|lost|terminat|consuming"):
        await answered(connection, connection.execute("SELECT pg_sleep(5)"))
    assert connection.closed


@pytest.mark.postgres
@pytest.mark.real_time
async def test_pool_in_transaction_mode_is_refused_and_in_session_mode_is_used(pgbouncer):
    store = PostgresStore(pgbouncer("transaction"))
    with pytest.raises(StoreError, match=r"a connection pool in transaction mode.*pool_mode ="):
        await store.refresh()
    await store.close()
    stores = [PostgresStore(pgbouncer("session")) for _ in range(2)]
    await stores[0].refresh()
    await stores[1].refresh()
    await asyncio.sleep(0.3)
    await stores[0].transact(lambda state, now: state.set_meta(next_id=7))
    async with asyncio.timeout(5):
        while stores[1].state.meta.next_id != 7:
            await asyncio.sleep(0.01)
    for store in stores:
        await store.close()
