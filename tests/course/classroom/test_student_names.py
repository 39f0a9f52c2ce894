"""Valid names of students, and the accounts and namespaces that are derived from them."""

import pytest

from taskrpc.core import names
from taskrpc.core.security.roles import account_name_problem
from taskrpc.course.classroom.student_names import (
    account_for,
    cleaned,
    namespace_of,
    student_name_problem,
)


@pytest.mark.parametrize(
    ("name", "account"),
    [
        ("José", "Jose"),
        ("Jose\u0301", "Jose"),
        ("Müller", "Muller"),
        ("Straße", "Strasse"),
        ("Łukasz Żółć", "Lukasz_Zolc"),
        ("O\N{RIGHT SINGLE QUOTATION MARK}Brien", "OBrien"),
        ("O'Neil, Ann", "O_Neil_Ann"),
        ("李 Wei", "Wei"),
        ("محمد علي", "student1"),
        ("小明", "student1"),
        ("نی\N{ZERO WIDTH NON-JOINER}لا", "student1"),
        ("x" * 100, "x" * 40),
    ],
)
def test_an_account_is_derived_from_a_name(name, account):
    name = cleaned(name)
    assert student_name_problem(name) == ""
    assert account_for(name, lambda _: True) == account
    assert account_name_problem(account) == ""


def test_a_taken_account_is_numbered():
    taken = {"Jose", "Jose2", "student1"}
    assert account_for("José", lambda account: account not in taken) == "Jose3"
    assert account_for("小明", lambda account: account not in taken) == "student2"


@pytest.mark.parametrize(
    "name", ["", "---", "a;b", "<b>", "x\x1b[31m", "\N{RIGHT-TO-LEFT OVERRIDE}abc", "a" * 101]
)
def test_invalid_student_name_is_refused(name):
    assert "a student's name: expected 1 to 100 letters" in student_name_problem(name)


def test_repeated_spaces_become_single():
    assert cleaned("  Ada \t Lovelace\u00a0 ") == "Ada Lovelace"


@pytest.mark.parametrize(
    ("name", "namespace"),
    [("ada", "/ada"), ("ada@uni.example", "/ada_uni_example"), ("7b", "/s_7b"), ("_x", "/s__x")],
)
def test_every_name_gives_a_valid_namespace(name, namespace):
    assert namespace_of(name) == namespace
    assert names.check_namespace(namespace) == namespace
