"""The numbers of tf2_monitor, and its lines."""

import pytest


def test_delays_are_reported_as_on_ros(ros):
    delays = ros.module("tf2_ros.tf2_monitor").Delays()
    assert delays.report() == "\nFrames:\n\nAll Broadcasters:"
    delays.add(10.0, {"odom": 9.75, "base": 9.5})
    assert delays.report() == (
        "\nFrames:\n"
        "Frame: base, published by <no authority available>, Average Delay: 0.5, Max Delay: 0.5\n"
        "Frame: odom, published by <no authority available>, Average Delay: 0.25, Max Delay: 0.25\n"
        "\nAll Broadcasters:\n"
        "Node: <no authority available> 1e+08 Hz, Average Delay: 0.375 Max Delay: 0.375"
    )
    delays.add(12.0, {"odom": 11.25})
    assert delays.report(["odom"]).splitlines()[2:] == [
        "Frame: odom, published by <no authority available>, Average Delay: 0.5, Max Delay: 0.75",
        "",
        "All Broadcasters:",
        "Node: <no authority available> 1 Hz, Average Delay: 0.5625 Max Delay: 0.75",
    ]


def test_wrong_arguments_end_with_the_usage(ros, capsys):
    with pytest.raises(SystemExit) as ended:
        ros.module("tf2_ros.tf2_monitor").main(["tf2_monitor", "one"])
    assert ended.value.code == 1
    assert capsys.readouterr().out == "TF_Monitor: usage: tf2_monitor framea frameb\n"
