"""The rendered text is valid in Prometheus' format for every label and help text."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from taskrpc.observe.metrics import Family, Histogram, Kind, Sample, render
from tests.observe.metrics.exposition import read
from tests.properties import examples

TEXTS = st.text(
    st.characters(
        exclude_categories=("Cs",), exclude_characters="\r\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"
    )
)
NUMBERS = st.floats() | st.integers(-(2**60), 2**60)


def test_a_page_looks_so():
    times = Histogram([0.1, 1])
    for seconds in (0.05, 0.1, 0.5, 7):
        times.observe(seconds)
    labels = {"service": "/add"}
    text = render(
        [
            Family("calls_total", Kind.COUNTER, "Calls.", [Sample(4, {**labels, "code": "OK"})]),
            Family("nothing", Kind.GAUGE, "Left out.", []),
            Family("call_seconds", Kind.HISTOGRAM, "Times.", times.samples(labels)),
            Family("late", Kind.GAUGE, "A number.", [Sample(0.25)]),
        ]
    )
    assert text == (
        "# HELP calls_total Calls.\n"
        "# TYPE calls_total counter\n"
        'calls_total{service="/add",code="OK"} 4\n'
        "# HELP call_seconds Times.\n"
        "# TYPE call_seconds histogram\n"
        'call_seconds_bucket{service="/add",le="0.1"} 2\n'
        'call_seconds_bucket{service="/add",le="1"} 3\n'
        'call_seconds_bucket{service="/add",le="+Inf"} 4\n'
        'call_seconds_sum{service="/add"} 7.65\n'
        'call_seconds_count{service="/add"} 4\n'
        "# HELP late A number.\n"
        "# TYPE late gauge\n"
        "late 0.25\n"
    )


@settings(max_examples=examples(60))
@given(TEXTS, TEXTS, NUMBERS)
def test_labels_helps_and_numbers_come_back_as_they_were(label, help_, value):
    text = render([Family("x", Kind.GAUGE, help_, [Sample(value, {"a": label, "b": "1"})])])
    kind, told, samples = read(text)["x"]
    assert (kind, told) == ("gauge", help_)
    ((_, labels), got), *_ = samples.items()
    assert dict(labels) == {"a": label, "b": "1"}
    assert got == float(value) or (math.isnan(got) and math.isnan(value))


@settings(max_examples=examples(60))
@given(TEXTS, NUMBERS)
def test_prometheus_own_reader_agrees(label, value):
    text = render([Family("x_total", Kind.COUNTER, "What.", [Sample(value, {"a": label})])])
    (family,) = text_string_to_metric_families(text)
    (sample,) = family.samples
    assert (sample.name, sample.labels) == ("x_total", {"a": label})
    assert sample.value == float(value) or math.isnan(value)


@settings(max_examples=examples(60))
@given(st.lists(st.floats(0, 100)))
def test_each_bucket_counts_values_up_to_its_bound(seconds):
    times = Histogram([0.5, 1, 50])
    for each in seconds:
        times.observe(each)
    samples = read(render([Family("x", Kind.HISTOGRAM, "What.", times.samples())]))["x"][2]
    for bound in ("0.5", "1", "50", "+Inf"):
        expected = sum(each <= float(bound) for each in seconds)
        assert samples["x_bucket", (("le", bound),)] == expected
    assert samples["x_sum", ()] == pytest.approx(sum(seconds))


@pytest.mark.parametrize("name", ["", "1x", "a-b", "x\n", "é"])
def test_a_name_that_prometheus_would_refuse_is_refused_here(name):
    with pytest.raises(ValueError, match="expected a name that matches"):
        render([Family(name, Kind.GAUGE, "What.", [Sample(1)])])
    with pytest.raises(ValueError, match="expected a name that matches"):
        render([Family("x", Kind.GAUGE, "What.", [Sample(1, {name: "a"})])])


def test_a_label_of_prometheus_own_is_refused():
    with pytest.raises(ValueError, match="expected a name that matches"):
        render([Family("x", Kind.GAUGE, "What.", [Sample(1, {"__name__": "a"})])])


def test_duplicate_family_is_refused():
    with pytest.raises(ValueError, match="two families have the name x"):
        render([Family("x", Kind.GAUGE, "What.", [Sample(1)])] * 2)


def test_bounds_that_do_not_rise_are_refused():
    with pytest.raises(ValueError, match="expected ascending numbers"):
        Histogram([1, 1])


@pytest.mark.parametrize(
    "lie",
    [
        "x 1\n",
        "# HELP x What.\n# TYPE x gauge\nx 1\nx 2\n",
        "# HELP x What.\n# TYPE x counter\nx 1\n",
        "# HELP x What.\n# TYPE x gauge\nx one\n",
        '# HELP x What.\n# TYPE x gauge\nx{a="\\t"} 1\n',
        "# HELP x What.\n# TYPE x gauge\nx 1",
        "# HELP x What.\n# TYPE x histogram\n"
        'x_bucket{le="1"} 2\nx_bucket{le="+Inf"} 1\nx_sum 1\nx_count 1\n',
    ],
)
def test_the_strict_reader_catches_a_lie(lie):
    with pytest.raises((AssertionError, KeyError)):
        read(lie)
