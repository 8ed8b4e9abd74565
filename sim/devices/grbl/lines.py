"""How GRBL makes a line out of characters: upper case, no spaces, no comments, at most 79 of what is left."""

LONGEST = 79


class LineAssembler:
    """Takes one character at a time; overflowed tells whether the line just returned was too long."""

    def __init__(self) -> None:
        self.overflowed = False
        self.clear()

    def clear(self) -> None:
        self._text: list[str] = []
        self._comment = ""
        self._too_long = False

    def feed(self, byte: int) -> str | None:
        """Returns a line at CR or at LF (so CR LF gives an empty line more), else None."""
        char = chr(byte)
        if char in "\r\n":
            line, self.overflowed = "".join(self._text), self._too_long
            self.clear()
            return line
        self._add(char)
        return None

    def _add(self, char: str) -> None:
        if self._comment:
            if char == ")" and self._comment == "(":
                self._comment = ""
        elif char in "(;":
            self._comment = char
        elif char > " " and char != "/":
            self._too_long = self._too_long or len(self._text) >= LONGEST
            self._text.append(char.upper())
