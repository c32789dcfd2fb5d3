"""How finely the page draws, told when its frames come (ms) instead of looking at a clock."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

from tests.helpers.browser import Browser

# Each frame with the time since the one before.
QUICK, SLOW = ("moving", 17), ("moving", 60)
STILL, LAZY = ("rests", 17), ("rests", 60)


def answers(browser: Browser, *frames: tuple[str, int]) -> list[Any]:
    """Return how finely each frame is drawn that moves, and of others whether they are at rest."""
    text = (resources.files("mlscli.view") / "web" / "detail.js").read_text(encoding="utf-8")
    told: list[Any] = browser.evaluate(
        f"(() => {{ {text}; const detail = new Detail(); let now = 1000; return "
        f"{json.dumps(frames)}.map(([act, time]) => detail[act](now += time)); }})()"
    )
    return told


def test_quick_frames_are_smooth(browser: Browser) -> None:
    assert set(answers(browser, *20 * [QUICK])) == {"smooth"}


def test_slow_frames_are_drawn_ever_coarser(browser: Browser) -> None:
    told = answers(browser, *40 * [SLOW])
    assert sorted(set(told), key=told.index) == ["smooth", "rough", "coarse"]
    assert told.index("coarse") <= 12
    assert told[-1] == "coarse"


def test_one_frame_that_takes_seconds_decides_nothing(browser: Browser) -> None:
    told = answers(browser, *5 * [QUICK], ("moving", 3000), *10 * [QUICK])
    assert set(told) == {"smooth"}


def test_a_pause_is_no_slow_frame(browser: Browser) -> None:
    told = answers(browser, *20 * [QUICK, *6 * [STILL]])
    assert set(told) == {"smooth", True}


def test_a_frame_is_slow_whether_the_view_moves_on_or_not(browser: Browser) -> None:
    told = answers(browser, *40 * [QUICK, LAZY])
    assert "coarse" in told


def test_a_view_that_was_smooth_is_at_rest_at_once_another_after_a_while(browser: Browser) -> None:
    assert answers(browser, *5 * [QUICK], STILL)[-1] is True
    told = answers(browser, *40 * [SLOW], *20 * [STILL])[40:]
    assert told == sorted(told)
    assert 10 <= told.index(True) <= 13


def test_where_the_finest_was_quick_the_next_motion_is_finer(browser: Browser) -> None:
    coarse, rest, restless = 40 * [SLOW], 30 * [STILL], 5 * [LAZY]
    told = answers(browser, *coarse, *rest, QUICK, *rest, QUICK)
    assert [told[70], told[101]] == ["rough", "smooth"]
    told = answers(browser, *coarse, *restless, *rest, QUICK)
    assert told[-1] == "coarse"


def test_how_long_a_page_is_hidden_tells_nothing(browser: Browser) -> None:
    hidden = [("pause", 0), ("rests", 60_000)]
    told = answers(browser, QUICK, STILL, STILL, *hidden, *10 * [STILL], QUICK)
    assert told[-1] == "smooth"


def test_where_the_finest_took_long_motion_begins_without_it(browser: Browser) -> None:
    told = answers(browser, QUICK, STILL, ("rests", 300), *10 * [STILL], QUICK)
    assert [told[0], told[-1]] == ["smooth", "rough"]
