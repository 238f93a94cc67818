"""What can go wrong. The text of each error says what happened, where, and what to do."""


class PmacError(Exception):
    """The board or the daemon refused, or did not answer.

    ``code`` is the board's error number (3 of ``ERR003``), or 0 where the board itself did not refuse.
    ``lines`` is what the board had answered before.
    """

    def __init__(self, message: str, code: int = 0, lines: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.code = code
        self.lines = tuple(lines)


class StaleData(PmacError):
    """The data are old: the board or the daemon does not update them. They are never given as live."""


class DaemonGone(PmacError):
    """No daemon runs under this name. The next call attaches to a new one by itself."""
