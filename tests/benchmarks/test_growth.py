"""Growth is distinguished from noise, compared with its limit, and shown for each topic."""

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from benchmarks.growing.curves import Curve, Measure, power
from benchmarks.growing.picture import picture
from benchmarks.growing.report import report, to_json
from benchmarks.growing.topics import TOPICS, topic

ROOT = Path(__file__).parents[2]
COST, RATE = Measure("m", "a thing", "µs"), Measure("r", "things", "calls/s")
SIZES = (1, 10, 100, 1000, 10_000)


@pytest.mark.parametrize("exponent", [0, 0.5, 1, 2])
def test_exponent_is_that_of_the_generating_law(exponent):
    assert power(SIZES, [3 * size**exponent for size in SIZES]) == pytest.approx(exponent)
    falling = tuple(1e9 / size**exponent for size in SIZES)
    assert Curve(RATE, SIZES, falling).exponent == pytest.approx(exponent)


def test_growth_behind_a_fixed_cost_is_found():
    curve = Curve(COST, SIZES, tuple(300 + size for size in SIZES))
    assert curve.exponent < 0.4
    assert not curve.is_within
    assert Curve(COST, SIZES, (300.0, 320.0, 290.0, 310.0, 330.0)).is_within


def test_unmeasured_sizes_are_left_out():
    curve = Curve(COST, SIZES, (0.0, 0.0, 5.0, 5.0, 5.0))
    assert curve.known.sizes == (100, 1000, 10_000)
    assert curve.exponent == pytest.approx(0)
    assert Curve(COST, (1,), (0.0,)).known.sizes == ()


def test_report_and_picture_show_each_curve_and_name_too_fast_growth():
    fast = Curve(COST, SIZES, tuple(float(size) for size in SIZES))
    unknown = Curve(Measure("u", "unknown", "bytes"), SIZES, (0.0,) * 5)
    found = [(TOPICS[0], [fast, Curve(RATE, SIZES, (9.0,) * 5), unknown])]
    about = dict.fromkeys(("date", "cpu", "cores", "system", "python", "commit"), "x")
    text = report({**about, "quick": True}, found)
    assert "1 of 3 costs grow faster than they may:\n\n- a thing: +1.00" in text
    assert "| a thing | µs | 1.00 | 10.0 | 100 | 1,000 | 10,000 | +1.00 | +1.00 |" in text
    assert json.loads(to_json(about, found))["topics"]["connections"]["m"]["exponent"] == 1
    ET.fromstring(picture("A <title>", [(TOPICS[0].title, found[0][1])]))


@pytest.mark.end_to_end
@pytest.mark.real_time
@pytest.mark.parametrize("name", [each.name for each in TOPICS])
def test_each_topic_measures_all_its_curves(name):
    command = [sys.executable, "-m", "benchmarks.growing.child", name, "20", "0.02"]
    home = {"ROS_DOMAIN_ID": "0", "TASKRPC_INTERFACE_PATH": str(ROOT / "benchmarks/interfaces")}
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **home}, stdout=subprocess.PIPE, check=True
    )
    found = json.loads(done.stdout)
    assert set(found) >= {measure.name for measure in topic(name).measures}
    assert all(value >= 0 for value in found.values())
