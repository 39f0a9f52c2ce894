import asyncio

import pytest

from taskrpc.errors import StoreError, TaskRpcError

pytest.importorskip("psycopg")

from taskrpc.fleet.postgres_connection import DatabaseUrl, answered, close
from taskrpc.fleet.postgres_store import PostgresStore

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
    monkeypatch.setattr("taskrpc.fleet.postgres_connection.ANSWER_TIMEOUT", 0.2)
    connection = await DatabaseUrl(postgres_url).connect("test")
    with pytest.raises(Exception, match=r"closed|lost|terminat|consuming"):
        await answered(connection, connection.execute("SELECT pg_sleep(5)"))
    assert connection.closed
