"""Who may have how much, and whose turn is next."""

from __future__ import annotations

import asyncio

from server.shares import Few


def test_a_few_go_in_each_turn_of_the_loop_and_who_leaves_holds_up_nobody() -> None:
    async def count() -> tuple[list[int], int]:
        few, turn, went = Few(3), 0, list[int]()

        async def send(times: int) -> None:
            for _ in range(times):
                await few.turn()
                went.append(turn)

        sending = [asyncio.create_task(send(4)) for _ in range(10)]
        await asyncio.sleep(0)
        for each in sending[5:7]:
            each.cancel()
        while not all(each.done() for each in sending):
            turn += 1
            await asyncio.sleep(0)
        return went, sum(each.cancelled() for each in sending)

    went, left = asyncio.run(count())
    assert left == 2
    assert len(went) >= 8 * 4
    assert max(map(went.count, went)) <= 3
    assert went[-1] < 30
