"""Command lines to the board, and the replies."""

import pmac_dpram
from softioc import builder

from .records import Message, puts, shortened

REPLY_BYTES = 8192


class Commands:
    """``{prefix}CMD`` takes a line; a put with completion returns when ``REPLY`` and ``MSG`` tell what came of it."""

    def __init__(self, prefix, acting, writable):
        self._acting = acting
        self._reply = builder.longStringIn(f"{prefix}REPLY", length=REPLY_BYTES)
        self._message = Message(f"{prefix}MSG")
        builder.longStringOut(
            f"{prefix}CMD",
            length=256,
            always_update=True,
            blocking=True,
            on_update=self._send,
            **puts(writable),
        )

    async def _send(self, line):
        try:
            lines = await self._acting.run("commands", lambda: self._acting.board.command(line))
        except pmac_dpram.PmacError as error:
            self._reply.set(shortened("\n".join(error.lines), REPLY_BYTES))
            self._message.tell(error)
            return
        self._reply.set(shortened("\n".join(lines), REPLY_BYTES))
        self._message.clear()
