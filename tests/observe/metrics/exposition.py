"""A strict reader of Prometheus' text format 0.0.4, written from its description alone.

It refuses what Prometheus itself would let pass: families that are torn apart, samples without
HELP and TYPE, counters that do not end with `_total`, histograms that do not add up.
"""

import math
import re

_COMMENT = re.compile(r"# (HELP|TYPE) ([a-zA-Z_:][a-zA-Z0-9_:]*) (.*)")
_SAMPLE = re.compile(r"([a-zA-Z_:][a-zA-Z0-9_:]*)(?:\{(.*)\})? (\S+)")
_LABEL = re.compile(r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\[\\"n])*)"(?:,|$)')
_NUMBER = re.compile(r"[+-]Inf|NaN|-?\d+(\.\d+)?(e[+-]?\d+)?")
_SUFFIXES = {"histogram": ("_bucket", "_sum", "_count")}


def unescaped(text):
    return re.sub(r"\\(.)", lambda found: {"n": "\n"}.get(found[1], found[1]), text)


def labels_of(text):
    found, at = {}, 0
    while at < len(text or ""):
        match = _LABEL.match(text, at)
        assert match, f"labels: {text[at:]!r}"
        assert match[1] not in found, f"the label {match[1]} comes twice"
        found[match[1]] = unescaped(match[2])
        at = match.end()
    return found


def read(text):
    """`{name: (type, help, {(sample name, sorted labels): value})}`."""
    assert text == "" or text.endswith("\n")
    families, name = {}, ""
    for line in text.splitlines():
        if comment := _COMMENT.fullmatch(line):
            what, name, rest = comment.groups()
            if what == "HELP":
                assert name not in families, f"{name} is torn apart"
                families[name] = [None, unescaped(rest), {}]
            else:
                family = families[name]
                assert family[0] is None
                assert not family[2], "TYPE must come before the samples"
                assert rest in ("counter", "gauge", "histogram")
                family[0] = rest
            continue
        sample = _SAMPLE.fullmatch(line)
        assert sample, f"not a sample: {line!r}"
        kind = families[name][0]
        allowed = [name + suffix for suffix in _SUFFIXES.get(kind, ("",))]
        assert sample[1] in allowed, f"{sample[1]} in the family {name}"
        assert _NUMBER.fullmatch(sample[3]), sample[3]
        key = sample[1], tuple(sorted(labels_of(sample[2]).items()))
        assert key not in families[name][2], f"{key} comes twice"
        families[name][2][key] = float(sample[3])
    for name, (kind, _, samples) in families.items():
        assert samples, f"{name} has no samples"
        if kind == "counter":
            assert name.endswith("_total")
            assert all(value >= 0 for value in samples.values())
        if kind == "histogram":
            _check_histogram(name, samples)
    return {name: tuple(family) for name, family in families.items()}


def _check_histogram(name, samples):
    series = {}
    for (sample, labels), value in samples.items():
        own = tuple(each for each in labels if each[0] != "le")
        parts = series.setdefault(own, {"_bucket": [], "_sum": None, "_count": None})
        suffix = sample.removeprefix(name)
        if suffix == "_bucket":
            parts["_bucket"].append((float(dict(labels)["le"]), value))
        else:
            parts[suffix] = value
    for parts in series.values():
        bounds = [bound for bound, _ in parts["_bucket"]]
        counts = [count for _, count in parts["_bucket"]]
        assert bounds == sorted(set(bounds))
        assert bounds[-1] == math.inf
        assert counts == sorted(counts)
        assert counts[-1] == parts["_count"]
        assert parts["_sum"] is not None


def values(text, name):
    """The samples of a family, by the values of their labels (joined), histograms' parts too."""
    samples = read(text)[name][2]
    return {
        "/".join(filter(None, [sample.removeprefix(name), *(each for _, each in labels)])): value
        for (sample, labels), value in samples.items()
    }
