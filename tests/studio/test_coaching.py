"""What a page reads of the coach's lines."""

from dataclasses import replace

from schuler.calibration.field.advice import Advice
from schuler.studio.coaching import CoachState, coach_state

ADVICE = Advice(
    t=110.5, elapsed=10.5, share={}, remaining={"b_a_x": 0.5}, out_of_reach={}, progress=0.07, turn=None, rest_s=5.0,
    next="turn 90 deg clockwise about y (seen along y), to nose up (x up); rest 5 s (for b_a_x)",
    gain=0.1, done=False, rests=1, moving=False,
)  # fmt: skip
MOVE, _, _ = ADVICE.next.partition(" (for ")


def test_advice_and_what_happens_after_it():
    line = ADVICE.line()
    assert coach_state([]) is None
    assert coach_state(["schuler: reading", line]) == CoachState(10.5, 7, MOVE, "b_a_x", "")
    assert coach_state([line, "  12.0 s  turning"]) == CoachState(12.0, 7, MOVE, "b_a_x", "turning")
    lines = [line, "  12.0 s  turning", "  14.8 s  resting: hold it"]
    assert coach_state(lines) == CoachState(14.8, 7, MOVE, "b_a_x", "resting")
    unsteady = "  40.0 s  no rest for 20 s: put it down, or hold it steadier"
    assert coach_state([*lines, unsteady]).motion == "turning"
    assert coach_state([*lines, "\a" + replace(ADVICE, elapsed=20.0).line()]).elapsed_s == 20.0


def test_the_end_has_no_reason():
    done = replace(ADVICE, remaining={}, progress=1.0, next="done: stop, nothing that can be improved soon is left")
    assert coach_state([done.line()]) == CoachState(10.5, 100, done.next, "", "")
