"""Where the output of a launch goes."""

import pytest


def test_presets_of_output(launch):
    targets = launch.logging.output_targets
    assert targets("screen") == {"stdout": {"screen"}, "stderr": {"screen"}}
    assert targets("log") == {"stdout": {"log"}, "stderr": {"log", "screen"}}
    assert targets("both") == {"stdout": {"log", "screen"}, "stderr": {"log", "screen"}}
    assert targets({"stdout": "screen", "both": {"own_log"}}) == {
        "stdout": {"screen", "own_log"},
        "stderr": {"own_log"},
    }


@pytest.mark.parametrize("output", ["scren", {"stdin": "log"}, {"stdout": "paper"}])
def test_unknown_output_is_refused(launch, output):
    with pytest.raises(ValueError, match="expected"):
        launch.logging.output_targets(output)


def test_lines_are_on_the_screen_and_in_the_log_file(launch, capsys, tmp_path):
    launch.logging.get_logger("talker-1").warning("hot")
    assert capsys.readouterr().out == "[WARNING] [talker-1]: hot\n"
    (path,) = tmp_path.glob("log/*/launch.log")
    assert path.read_text().endswith(" [WARNING] [talker-1]: hot\n")
    assert str(path.parent) == launch.logging.launch_config.log_dir
