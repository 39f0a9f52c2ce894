"""Hidden checks of lab 3, for the lecturer: other orders of the responses, and ticks between them."""

from taskrpc.course.labs.checks.lab3 import all_sent, held_service, shows, ticks
from taskrpc.course.labs.lab import Check, NotMet


async def _shows_in_any_order(trial):
    async with held_service(trial) as held:
        client = await all_sent(trial, held)
        first, second, third = held.sums
        orders = [(second, first, third), (second, third, first), (third, first, second)]
        await shows(trial, held, client, orders[trial.unpredictable(0, 2)])


async def _ticks_until_the_end(trial):
    async with held_service(trial) as held:
        client = await all_sent(trial, held)
        *first, last = held.sums
        await shows(trial, held, client, first)
        if not await ticks(trial, client, 3):
            raise NotMet(
                "the timer to tick until the last response is there",
                "it ticked before, but not after the first responses",
                "what does the program do between the responses?",
            )
        await shows(trial, held, client, [last])


CHECKS = (
    Check("the client shows responses in any order", 2, _shows_in_any_order),
    Check("the timer ticks until the last response", 2, _ticks_until_the_end),
)
