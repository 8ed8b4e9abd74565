"""What the page says, as the codes beside its sentences: the sentences themselves are in sentences.txt."""

import re


def coded(code: str) -> tuple[str, re.Pattern[str]]:
    """The attribute of an element that says this, perhaps among others; for expect(…).to_have_attribute(*…)."""
    return "data-code", re.compile(rf"(^|\s){re.escape(code)}(\s|$)")
