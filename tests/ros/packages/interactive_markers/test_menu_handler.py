"""The context menu of interactive markers."""

import importlib

import pytest


@pytest.fixture
def menu(ros_names):
    return importlib.import_module("interactive_markers").MenuHandler()


def test_a_marker_gets_the_visible_entries_with_their_check_boxes(menu, server, messages):
    server.insert(messages.InteractiveMarker(name="a"))
    server.applyChanges()
    first = menu.insert("first")
    below = menu.insert("below", parent=first)
    hidden = menu.insert("hidden")
    menu.setVisible(hidden, False)
    menu.setCheckState(below, menu.CHECKED)
    assert menu.apply(server, "a")
    shown = [(one.id, one.parent_id, one.title) for one in server.get("a").menu_entries]
    assert shown == [(first, 0, "first"), (below, first, "[x] below")]
    menu.setCheckState(below, menu.UNCHECKED)
    assert menu.reApply(server)
    assert server.get("a").menu_entries[1].title == "[ ] below"
    assert (menu.getTitle(below), menu.getCheckState(below)) == ("below", menu.UNCHECKED)


def test_a_selection_calls_the_callback_of_its_entry(menu, server, messages):
    selected = []
    server.insert(messages.InteractiveMarker(name="a"))
    server.applyChanges()
    handle = menu.insert("go", callback=lambda one: selected.append(one.menu_entry_id))
    silent = menu.insert("nothing")
    menu.apply(server, "a")
    for entry in (handle, silent, 99):
        feedback = messages.InteractiveMarkerFeedback(marker_name="a", menu_entry_id=entry)
        feedback.event_type = feedback.MENU_SELECT
        server.processFeedback(feedback)
    assert selected == [handle]


def test_missing_markers_and_entries_are_reported(menu, server, capsys):
    assert not menu.apply(server, "a")
    assert menu.insert("x", parent=7) is None
    assert capsys.readouterr().err == "Parent menu entry 7 not found.\n"
    assert not menu.setVisible(7, True)
    assert not menu.setCheckState(7, menu.CHECKED)
    assert (menu.getTitle(7), menu.getCheckState(7)) == (None, None)
