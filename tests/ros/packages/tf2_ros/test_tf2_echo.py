"""What tf2_echo prints, to the letter."""

import pytest


def test_transform_is_printed_as_on_ros(ros, link):
    text_of = ros.module("tf2_ros.tf2_echo").text_of
    assert text_of(link("base_link", "odom", sec=0, x=1.0, y=1.0, z=1.0)) == (
        "At time 0.0\n"
        "- Translation: [1.000, 1.000, 1.000]\n"
        "- Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.000, 1.000]\n"
        "- Rotation: in RPY (radian) [0.000, -0.000, 0.000]\n"
        "- Rotation: in RPY (degree) [0.000, -0.000, 0.000]\n"
        "- Matrix:\n"
        "  1.000  0.000  0.000  1.000\n"
        "  0.000  1.000  0.000  1.000\n"
        "  0.000  0.000  1.000  1.000\n"
        "  0.000  0.000  0.000  1.000"
    )
    message = link("a", "b", x=-12.3456)
    message.header.stamp.nanosec = 5
    message.transform.rotation.z = message.transform.rotation.w = 0.5**0.5
    assert "At time 1.5\n- Translation: [-12.346, 0.000, 0.000]\n" in text_of(message)
    assert "(degree) [0.000, -0.000, 90.000]\n- Matrix:\n  0.000 -1.000" in text_of(message)
    assert "\n  0.000 -1.000  0.000 -12.346\n" in text_of(message)


def test_wrong_arguments_end_with_the_usage(ros, capsys):
    main = ros.module("tf2_ros.tf2_echo").main
    with pytest.raises(SystemExit) as ended:
        main(["tf2_echo", "one"])
    assert ended.value.code == 1
    assert capsys.readouterr().out.startswith(
        "Usage: tf2_echo source_frame target_frame [echo_rate]\n\nThis will echo the transform"
    )
    for rate, text in (
        ("fast", "Failed to convert rate argument 'fast' to a floating-point number"),
        ("0", "expected an echo rate above 0, in Hz, got 0"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["tf2_echo", "a", "b", rate])
        assert ended.value.code == text
