"""The rule: each of its numbers decides something here, and is handed on wherever it is asked for."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_rule import PROBES, answer

import frictionjax.diagnosis
from frictionjax.diagnosis.rule import Rule

pytestmark = pytest.mark.untyped

TODAY = Rule()
PACKAGE = Path(frictionjax.diagnosis.__path__[0])


def test_every_number_has_a_decision():
    assert list(PROBES) == list(TODAY.numbers())


@pytest.mark.parametrize("name", PROBES)
def test_the_rule_of_today_decides_as_it_did(name):
    for probe, expected in PROBES[name]:
        assert answer(probe, TODAY) == expected


@pytest.mark.parametrize("factor", [0.5, 1.5])
@pytest.mark.parametrize("name", PROBES)
def test_a_number_that_changes_by_a_half_changes_a_decision(name, factor):
    other = TODAY.changed({name: factor * TODAY.numbers()[name]})
    assert any(answer(probe, other) != expected for probe, expected in PROBES[name])


def test_a_name_that_the_rule_does_not_have_is_refused():
    with pytest.raises(KeyError, match=r"accept\.most"):
        TODAY.changed({"accept.most": 1.0})


def _asking(tree: ast.Module, word: str) -> Iterator[str]:
    """Names of the functions, and of the methods with a dot, that take `word` by keyword."""
    functions = {id(node) for node in tree.body}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and any(own.arg == word for own in node.args.kwonlyargs):
            yield node.name if id(node) in functions else f".{node.name}"


def _calls(tree: ast.Module) -> Iterator[tuple[str, ast.Call]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            method = isinstance(node.func, ast.Attribute)
            yield f".{node.func.attr}" if method else getattr(node.func, "id", ""), node


@pytest.mark.parametrize("word", ["rule", "effort"])
def test_what_is_asked_for_is_handed_on(word):
    """No step of a diagnosis falls back on today's numbers when the caller gave others."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")}
    asking = {name for tree in trees.values() for name in _asking(tree, word)}
    assert len(asking) > 5
    forgotten = [
        f"{path.name}:{call.lineno}: {name}"
        for path, tree in trees.items()
        for name, call in _calls(tree)
        if name in asking and word not in {keyword.arg for keyword in call.keywords}
    ]
    assert forgotten == []
