"""Who may have how much of what there is, and whose turn is next, so that no client keeps the others out.

A client is a token's name where tokens have names, and an address otherwise. Two rules do for everything that the
server gives out:

- `Shares`, for places and bytes: a client may hold as much as is left free, times a factor. Alone it gets a share of
  the whole; with others each gets less; and something is always left for one who comes next (A. K. Choudhury and
  E. L. Hahne, "Dynamic queue length thresholds for shared-memory packet switches", IEEE/ACM Trans. Networking 6, 1998).
- `Turns`, for time: next is the client that has had least, by its weight. One that was away comes back as if it had
  been served like those who stayed.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager

from server.problems import Problem

MOST_REMEMBERED = 1000
"""Clients whose time is remembered."""

AGAIN = {"Retry-After": "1"}
"""Header of what can be asked again a second later."""


class Lease:
    """What a client holds of a stock, until it is given back; a second time changes nothing.

    Attributes:
        amount: how much.
    """

    def __init__(self, shares: Shares, client: str, amount: int) -> None:
        self._shares, self._client, self.amount = shares, client, 0
        self.resize(amount)

    def resize(self, amount: int) -> None:
        """Hold this much from now on."""
        self._shares.add(self._client, amount - self.amount)
        self.amount = amount

    def release(self) -> None:
        """Give back what is held."""
        self.resize(0)


class Shares:
    """A stock that clients hold parts of.

    Args:
        what: what it is, for messages.
        total: how much there is.
        share: largest part (0 to 1) of it that one client may hold.
        changed: called when something was given back.
    """

    def __init__(self, what: str, total: int, share: float, changed: Callable[[], None] = lambda: None) -> None:
        self._what, self._total, self._share, self._changed = what, total, share, changed
        self._held: Counter[str] = Counter()
        self.held = 0

    def add(self, client: str, amount: int) -> None:
        """Count what a client takes, or gives back if negative."""
        self._held[client] += amount
        self.held += amount
        if not self._held[client]:
            del self._held[client]
        if amount < 0:
            self._changed()

    @property
    def full(self) -> bool:
        """Whether nothing is left."""
        return self.held >= self._total

    def allows(self, client: str, amount: int = 1) -> bool:
        """Whether a client may take as much more; one that holds nothing may take all that is left."""
        free, its = self._total - self.held, self._held[client]
        if amount > free:
            return not self.held  # more than there ever is goes when there is nothing else
        return not its or (its + amount) * (1.0 - self._share) <= free * self._share

    def take(self, client: str, amount: int = 1) -> Lease:
        """Let a client hold as much.

        Raises:
            Problem: `overloaded` if there is not as much left, `too-many` if it would be more than this client's share.
        """
        if not self.allows(client, amount):
            if amount > self._total - self.held:
                raise Problem("overloaded", f"all {self._total} {self._what} are taken", headers=AGAIN)
            its = self._held[client]
            raise Problem("too-many", f"{its} of {self._total} {self._what} are this client's", headers=AGAIN)
        return Lease(self, client, amount)


class Turns:
    """Time that clients have had, and with it whose turn is next.

    Args:
        weights: by client; 1 for those that are not in it.
    """

    def __init__(self, weights: Mapping[str, float]) -> None:
        self._weights = weights
        self._used: dict[str, float] = {}
        self._least = 0.0

    def order(self, waiting: Iterable[str]) -> list[str]:
        """Return the clients that wait, who is next first."""
        used = {client: max(self._used.get(client, 0.0), self._least) for client in waiting}
        ordered = sorted(used, key=used.__getitem__)
        if ordered:
            self._least = used[ordered[0]]
        return ordered

    def charge(self, client: str, amount: float) -> None:
        """Count what a client was given."""
        before = max(self._used.pop(client, 0.0), self._least)
        self._used[client] = before + amount / self._weights.get(client, 1.0)
        if len(self._used) > MOST_REMEMBERED:
            del self._used[next(iter(self._used))]  # who was given nothing for longest


class Few:
    """Lets a few through in each turn of the event loop, first come, first served.

    Args:
        most: how many.
    """

    def __init__(self, most: int) -> None:
        self._most = self._left = most
        self._waiting: deque[asyncio.Future[None]] = deque()

    async def turn(self) -> None:
        """Wait until there is room in a turn."""
        if self._left == self._most:
            asyncio.get_running_loop().call_soon(self._begin)
        if self._left:
            self._left -= 1
            return
        waits = asyncio.get_running_loop().create_future()
        self._waiting.append(waits)
        await waits

    def _begin(self) -> None:
        """Begin a turn: with those that wait, then with those that come."""
        self._left = self._most
        while self._left and self._waiting:
            waits = self._waiting.popleft()
            if not waits.done():  # who waited may have left
                waits.set_result(None)
                self._left -= 1
        if self._left < self._most:
            asyncio.get_running_loop().call_soon(self._begin)


class Gate:
    """Lets one at a time through, who has had least time first; between two, all else that waits has its turn."""

    def __init__(self) -> None:
        self._turns = Turns({})
        self._busy = False
        self._waiting: dict[str, asyncio.Future[None]] = {}

    @asynccontextmanager
    async def turn(self, name: str) -> AsyncIterator[None]:
        """Wait for one's turn; the time from then on is counted.

        Args:
            name: of who waits; it waits once at a time.
        """
        if self._busy:
            self._waiting[name] = asyncio.get_running_loop().create_future()
            try:
                await self._waiting[name]
            except asyncio.CancelledError:
                if self._waiting.pop(name, None) is None:  # it was its turn
                    self._next()
                raise
        self._busy = True
        begin = time.perf_counter()
        try:
            yield
        finally:
            self._turns.charge(name, time.perf_counter() - begin)
            asyncio.get_running_loop().call_soon(self._next)

    def _next(self) -> None:
        self._busy = bool(self._waiting)
        if self._busy:
            first = self._turns.order(self._waiting)[0]
            self._waiting.pop(first).set_result(None)
