"""How often names are right on simulated machines: counts, their intervals, and the sentences."""

import numpy as np
import pytest
from scipy.special import ndtri

from frictionjax.diagnosis.checked import (
    Check,
    CheckedAnswer,
    CheckedName,
    binomial_interval,
    given_name,
    is_right,
)


def test_the_interval_is_wilson_s():
    count, of, z = 7, 8, ndtri(0.975)
    low, high = binomial_interval(count, of)
    for rate in (low, high):  # both ends are z standard errors of their own away from what was met
        assert abs(count / of - rate) == pytest.approx(z * np.sqrt(rate * (1.0 - rate) / of), rel=1e-9)
    assert binomial_interval(0, 0) == (0.0, 1.0)
    assert binomial_interval(5, 5)[1] == 1.0


@pytest.mark.parametrize(
    ("acting", "classes", "right"),
    [
        ((), (), True),
        ((), (("ripple",),), False),
        (("ripple",), (), False),
        (("ripple",), (("ripple",),), True),
        (("ripple",), (("torque_ripple", "ripple"),), True),
        (("ripple",), (("ripple",), ("creep",)), False),
        (("ripple", "creep"), (("ripple", "creep"),), False),
        (("ripple", "creep"), (("creep",), ("torque_ripple", "ripple")), True),
        (("ripple", "delay"), (("ripple",), ("creep",)), False),
    ],
)
def test_an_answer_is_right_when_each_effect_is_in_a_class_of_its_own(acting, classes, right):
    assert is_right(acting, classes) is right


def test_a_name_is_given_as_a_member_of_a_class_too():
    assert given_name("ripple", (("torque_ripple", "ripple"),))
    assert not given_name("ripple", (("creep",),))


def test_the_sentences_say_how_often():
    name = CheckedName("maxwell_slip", given=8, right=7, acting=10, found=7)
    answers = (
        CheckedAnswer(("maxwell_slip",), "named", ("maxwell_slip",), True, 7),
        CheckedAnswer(("maxwell_slip",), "unknown", (), False, 3),
        CheckedAnswer((), "named", ("maxwell_slip",), False, 1),
        CheckedAnswer((), "adequate", (), True, 8),
    )
    check = Check(19, 1, (name,), answers)
    assert check.right == 15 and name.share == 7 / 8
    first, second = check.sentences
    assert first == (
        "On data like yours the name maxwell slip is right 7 of the 8 times that it is given (88 %, 95 % interval 53 "
        "to 98 %): maxwell slip acted in 10 of the simulated machines and was named in 7 of them."
    )
    assert second == (
        "Of 19 simulated machines 15 were diagnosed right (79 %, 95 % interval 57 to 91 %); 1 more could not be "
        "diagnosed."
    )


def test_a_name_that_was_never_given_has_no_rate():
    name = CheckedName("creep", 0, 0, 5, 0)
    assert np.isnan(name.share) and name.interval == (0.0, 1.0)
    assert name.sentence.startswith(
        "On data like yours no simulated machine was given the name creep: creep acted in 5"
    )
    assert Check(0, 4, (), ()).sentences == ("None of the 4 simulated machines could be diagnosed.",)
