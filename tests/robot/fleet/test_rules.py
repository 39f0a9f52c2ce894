import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.plan import HORIZON, FleetPlan
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.tasks import rules as requests
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.responses import TaskResponse
from tests.properties import examples
from tests.robot.fleet.fakes import line_plan, pose, robot, state_of, task

LEASE = 6.0


def nothing(*_):
    return ""


def submit(state, now, made, **settings):
    known = {"account": "", "unable": "", "queue_limit": 100, "share": None}
    return rules.submit(state, now, made, estimated=lambda task: 4.5, **(known | settings))


def carry_out(state, now, decision):
    return rules.carry_out(state, now, decision, lambda task: 1.0)


def cancel(state, now, task_id, client=""):
    decision = requests.cancel(state.tasks.get(task_id), task_id, now, client)
    return carry_out(state, now, decision)


def requeue(state, now, task_id, *, resume):
    task = state.tasks.get(task_id)
    decision = requests.requeue(task, task_id, now, "ann", resume=resume, refusal=nothing)
    return carry_out(state, now, decision)


def claim(state, name, epoch=1, now=0.0, refusal=nothing):
    claimed = rules.claim(state, now, name, epoch, line_plan, refusal)
    return None if claimed is None else claimed[0].task_id


# Leases


def test_new_robot_joins_with_a_lease():
    state = FleetState()
    joined = rules.join(state, 10.0, robot("a", lease_until=0.0), LEASE)
    assert (joined.epoch, joined.lease_until, joined.free_at) == (1, 16.0, 10.0)
    assert state.robots["a"] == joined


def test_second_server_with_the_same_robot_name_is_refused_while_the_lease_lasts():
    state = state_of(robot("a", lease_until=16.0, address="127.0.0.1:8642", host="lab-3", pid=4711))
    where = r"another server \(process 4711 on lab-3 at 127.0.0.1:8642\) drives 'a'.*6.0 s"
    with pytest.raises(rules.NameTaken, match=where):
        rules.join(state, 10.0, robot("a", server="another"), LEASE)
    assert rules.join(state, 16.0, robot("a", server="another"), LEASE).epoch == 2


def test_robot_that_comes_back_finds_its_task_interrupted():
    state = state_of(task(1), robot("a"))
    assert claim(state, "a") == 1
    rules.join(state, 5.0, robot("a"), LEASE)
    assert state.tasks[1].state is TaskState.INTERRUPTED
    assert state.robots["a"].task_id == 0


def test_renewal_moves_the_end_of_the_lease_and_tells_how_the_task_proceeds():
    state = state_of(task(1), robot("a"))
    claim(state, "a")
    assert rules.renew(state, 10.0, "a", 1, LEASE, remaining=7.0, progress=0.25) == 16.0
    assert (state.robots["a"].lease_until, state.robots["a"].free_at) == (16.0, 17.0)
    assert state.tasks[1].progress == 0.25


def test_report_of_an_idle_robot_that_is_older_than_its_claim_changes_no_estimate():
    state = state_of(task(1, "4"), robot("a"))
    claim(state, "a")
    rules.renew(state, 1.0, "a", 1, LEASE, pose=pose(0))
    assert (state.robots["a"].free_at, state.robots["a"].pose) == (5.0, pose(4))


def test_renewal_without_a_change_does_not_wake_the_other_servers():
    state = state_of(robot("a", 3))
    rules.renew(state, 10.0, "a", 1, LEASE, pose=pose(3))
    assert state.changes.robots
    assert not state.changes.notifies


def test_task_of_a_lost_server_is_interrupted_and_its_late_writes_are_refused():
    state = state_of(task(1), robot("a", lease_until=5.0), robot("b"))
    claim(state, "a")
    rules.renew(state, 5.0, "b", 1, LEASE)
    interrupted = state.tasks[1]
    assert interrupted.state is TaskState.INTERRUPTED
    assert interrupted.message == "the server of a did not renew its lease while it ran"
    ended = interrupted.requeued(6.0, 1).started(6.0).ended(TaskState.SUCCEEDED, 7.0)
    with pytest.raises(rules.Fenced, match="the lease of a has ended"):
        rules.update(state, 6.0, "a", 1, ended)
    with pytest.raises(rules.Fenced):
        rules.renew(state, 6.0, "a", 1, LEASE)
    with pytest.raises(rules.Fenced):
        claim(state, "a", now=6.0)


def test_server_that_leaves_frees_its_robot_and_interrupts_its_task():
    state = state_of(task(1), robot("a"))
    claim(state, "a")
    rules.leave(state, 3.0, "a", 1)
    assert state.robots["a"].is_gone
    assert state.tasks[1].message == "the server ended while it ran"


# Execution


def test_claim_takes_the_first_task_that_the_plan_gives_to_the_robot():
    state = state_of(task(1, "9"), task(2, "1"), robot("a", 0), robot("b", 9))
    assert claim(state, "a") == 2
    assert claim(state, "b") == 1
    assert (state.tasks[1].robot, state.tasks[1].state) == ("b", TaskState.RUNNING)
    assert (state.robots["b"].task_id, state.robots["b"].free_at) == (1, 1.0)


def test_paused_queue_gives_no_task():
    state = state_of(task(1), robot("a"))
    rules.pause(state, True)
    assert claim(state, "a") is None
    rules.pause(state, False)
    assert claim(state, "a") == 1


def test_claim_without_an_answer_is_put_back_by_the_next_claim():
    state = state_of(task(1), task(2, priority=9), robot("a"))
    assert claim(state, "a") == 2
    assert claim(state, "a") == 2
    assert state.tasks[2].state is TaskState.RUNNING
    assert list(state.begun) == [2]


def test_put_back_task_that_was_cancelled_meanwhile_is_canceled():
    state = state_of(task(1), robot("a"))
    claim(state, "a")
    cancel(state, 1.0, 1, "ann")
    assert claim(state, "a", now=2.0) is None
    assert (state.tasks[1].state, state.tasks[1].message) == (
        TaskState.CANCELED,
        "cancelled by ann",
    )


def test_robot_that_is_able_takes_a_task_far_behind_those_for_others():
    others = [task(number + 1, "0", task_type="scan") for number in range(HORIZON)]
    mine = task(HORIZON + 1, "0")
    robots = robot("a", capabilities="move"), robot("b", capabilities="scan")
    state = state_of(*others, mine, *robots)
    assert claim(state, "a") == HORIZON + 1


def test_end_of_a_task_frees_the_robot_where_it_is():
    state = state_of(task(1), robot("a"))
    claim(state, "a")
    ended = state.tasks[1].ended(TaskState.SUCCEEDED, 0.0, result="{}")
    rules.update(state, 8.0, "a", 1, ended, pose(4))
    assert (state.tasks[1].state, state.tasks[1].ended_at) == (TaskState.SUCCEEDED, 8.0)
    assert (state.robots["a"].task_id, state.robots["a"].pose) == (0, pose(4))
    rules.update(state, 9.0, "a", 1, ended, pose(4))  # again: the first got no answer
    assert state.tasks[1].ended_at == 8.0


def test_pause_of_a_running_task_is_stored_but_does_not_undo_a_cancel():
    state = state_of(task(1), robot("a"))
    claim(state, "a")
    running = state.tasks[1]
    cancel(state, 1.0, 1)
    rules.update(state, 2.0, "a", 1, running.moved_to(TaskState.PAUSED))
    assert state.tasks[1].state is TaskState.CANCELING


# Requests of clients


def test_submission_gets_the_next_number_and_the_databases_time():
    state = state_of(robot("a"))
    first, second = (submit(state, 5.0, task(0)) for _ in range(2))
    assert (first.task_id, second.task_id) == (1, 2)
    stored = state.tasks[2]
    assert (stored.arrival, stored.submitted_at, stored.accepted_estimate) == (2, 5.0, 4.5)


@pytest.mark.parametrize(
    ("options", "fields", "problem"),
    [
        ({"unable": "no robot"}, {}, "no robot"),
        ({}, {"priority": 11}, "Invalid priority: 11"),
        ({"queue_limit": 1}, {}, "Queue full"),
        ({"share": 1, "account": "ann"}, {"client": "ann"}, "Share full: ann"),
    ],
)
def test_refused_submission_changes_nothing(options, fields, problem):
    state = state_of(task(1, client="ann"), robot("a"))
    response = submit(state, 5.0, task(0, **fields), **options)
    assert not response.success
    assert response.message.startswith(problem)
    assert state.changes.is_empty


def test_cancel_of_a_running_task_asks_its_server_to_halt():
    state = state_of(task(1), task(2), robot("a"))
    claim(state, "a")
    assert cancel(state, 1.0, 1, "ann").message == "Task 1 is being cancelled"
    assert (state.tasks[1].state, state.tasks[1].robot) == (TaskState.CANCELING, "a")
    assert cancel(state, 1.0, 2, "ann").message == "Task 2 was cancelled"
    assert cancel(state, 1.0, 2, "ann").message == "Task 2 is cancelled already"
    assert cancel(state, 1.0, 3, "ann").message == "There is no task 3"


def test_second_cancel_while_the_robot_halts_changes_nothing():
    state = state_of(task(1), robot("a"))
    claim(state, "a")
    cancel(state, 1.0, 1, "ann")
    state.take_changes()
    assert cancel(state, 2.0, 1, "bob").message == "Task 1 is being cancelled"
    assert state.changes.is_empty
    assert state.tasks[1].message == "cancelled by ann"


def test_interrupted_task_is_queued_in_its_old_place_or_behind_its_equals():
    state = state_of(task(1), task(2), robot("a"), robot("b"))
    claim(state, "a")
    rules.leave(state, 1.0, "a", 1)
    assert requeue(state, 2.0, 1, resume=True).success
    assert (state.tasks[1].arrival, state.tasks[1].robot) == (1, "")
    cancel(state, 3.0, 1)
    response = requeue(state, 4.0, 1, resume=False)
    assert (response.message, response.estimated_time) == ("Task queued: move", 1.0)
    assert (state.tasks[1].arrival, state.tasks[1].accepted_estimate) == (3, 1.0)


def test_moved_task_and_task_that_is_queued_already_get_an_estimate():
    state = state_of(task(1), robot("a"))
    moved = requests.reprioritise(state.tasks[1], 1, 9, 1.0, "ann")
    assert carry_out(state, 1.0, moved) == TaskResponse(True, "Task 1 has priority 9", 1, 1.0)
    assert state.tasks[1].priority == 9
    already = TaskResponse(True, "Task 1 is queued already", 1, 1.0)
    assert requeue(state, 1.0, 1, resume=False) == already


def test_stop_halts_all_and_pauses():
    state = state_of(robot("a"))
    rules.stop(state, 0.0, "the robots were stopped by ann", "ann")
    assert (state.meta.paused, state.meta.halts) == (True, 1)


def test_pause_of_one_robot_gives_its_tasks_to_the_others():
    state = state_of(task(1, "1"), task(2, "9"), robot("a", 0), robot("b", 9))
    response = rules.pause_robot(state, 0.0, "a", True)
    assert response.message == "a is paused; the other robots continue"
    assert claim(state, "a") is None
    assert claim(state, "b") == 1
    assert rules.paused_robots(state) == ["a"]
    assert rules.pause_robot(state, 0.0, "a", False).message == "a is resumed"
    assert claim(state, "a") == 2


def test_robot_that_was_paused_by_name_stays_paused_when_its_server_restarts():
    state = state_of(robot("a"))
    rules.stop_robot(state, 0.0, "a", "a was stopped", "")
    rules.leave(state, 1.0, "a", 1)
    joined = rules.join(state, 2.0, robot("a", server="another"), LEASE)
    assert (joined.paused, joined.halts) == (True, 1)


def test_stop_of_one_robot_halts_no_other():
    state = state_of(robot("a"), robot("b"))
    assert rules.stop_robot(state, 0.0, "a", "a was stopped by ann", "ann").success
    stopped = state.robots["a"]
    assert (stopped.paused, stopped.halts, stopped.halt_reason) == (True, 1, "a was stopped by ann")
    assert state.robots["b"] == robot("b")
    assert (state.meta.halts, state.meta.paused) == (0, False)


def test_requests_for_one_robot_say_what_they_did_not_do():
    state = state_of(robot("a", is_gone=True))
    away = rules.stop_robot(state, 0.0, "a", "", "")
    assert away.message == "a is paused; its server does not run"
    for request in (
        rules.pause_robot(state, 0.0, "c\n", True),
        rules.stop_robot(state, 0.0, "c\n", "", ""),
    ):
        assert not request.success
        assert request.message == "There is no robot 'c?' in the fleet (expected one of: a)"
    rules.pause(state, True)
    resumed = rules.pause_robot(state, 0.0, "a", False).message
    assert "the queue is still paused (taskrpc task resume continues it)" in resumed


def test_queued_task_for_a_robot_that_is_away_says_so_and_waits():
    state = state_of(robot("a", capabilities="move:lab"), robot("b", capabilities="scan"))
    rules.leave(state, 1.0, "a", 1)
    response = submit(state, 1.0, task(0, "lab"))
    assert response.message == "Task queued: move (waits for a, which is away)"
    assert state.tasks[1].state is TaskState.QUEUED


def test_task_that_its_only_robot_refuses_fails_instead_of_waiting_for_ever():
    able, other = robot("a", capabilities="move"), robot("b", capabilities="scan")
    state = state_of(task(1, "1"), task(2, "2"), able, other)

    def refusal(task_type, target):
        return "no such shelf" if target == "1" else ""

    assert rules.may_claim(state, 0.0, "a", lambda *_: None, refusal)
    assert rules.claim(state, 0.0, "a", 1, lambda *_: None, refusal) is None
    failed = state.tasks[1]
    assert (failed.state, failed.message, failed.robot) == (TaskState.FAILED, "no such shelf", "a")
    assert state.tasks[2].state is TaskState.QUEUED


def test_task_that_another_robot_may_be_able_to_do_is_not_failed():
    state = state_of(task(1, "1"), robot("a"), robot("b", is_gone=True))
    assert rules.claim(state, 0.0, "a", 1, lambda *_: None, lambda *_: "no") is None
    assert state.tasks[1].state is TaskState.QUEUED


class Interleavings(RuleBasedStateMachine):
    """Any order of submissions, claims, ends, renewals, deaths, partitions and returns.

    Servers are what they believe: an epoch, and the task that they execute. A partitioned server
    keeps its belief and later acts on it.
    """

    NAMES = ("r0", "r1", "r2")

    @initialize()
    def begin(self):
        self.state = FleetState()
        self.now = 0.0
        self.epochs, self.executes, self.until = {}, {}, {}
        self.submitted, self.begun = set(), {}
        for index, name in enumerate(self.NAMES):
            self.join(name, index)

    def join(self, name, x=0):
        capabilities = {"r0": "", "r1": "move", "r2": "scan,move:1"}[name]
        made = robot(name, x, capabilities=capabilities, server=f"{name} {self.now}")
        self.epochs[name] = rules.join(self.state, self.now, made, LEASE).epoch
        self.until[name] = self.now + LEASE
        self.executes[name] = None

    def may_drive(self, name):
        return self.now < self.until[name]

    @rule(
        priority=st.integers(1, 10),
        place=st.sampled_from("0123"),
        kind=st.sampled_from(["move", "scan"]),
    )
    def submit(self, priority, place, kind):
        made = task(0, place, task_type=kind, priority=priority)
        self.submitted.add(submit(self.state, self.now, made).task_id)

    @rule(name=st.sampled_from(NAMES))
    def claim(self, name):
        if self.executes[name] is not None or not self.may_drive(name):
            return
        queued, robots = list(self.state.queued()), dict(self.state.robots)
        try:
            epoch = self.epochs[name]
            claimed = rules.claim(self.state, self.now, name, epoch, line_plan, nothing)
        except rules.Fenced:
            return
        if claimed is None:
            return
        begun, plan = claimed
        self.executes[name] = begun
        self.begun[begun.task_id] = self.begun.get(begun.task_id, 0) + 1
        self.check_order(name, begun, plan, queued, robots)

    def check_order(self, name, begun, plan, queued, robots):
        """A task ahead waits only for another robot, which ends it earlier than this one could."""
        live = [robots[each] for each in sorted(robots) if robots[each].is_live(self.now)]

        def task_at(index):
            return queued[index] if index < len(queued) else None

        whole = FleetPlan(task_at, live, self.state.abilities(), self.now, line_plan, name)
        for ahead in queued[: [each.task_id for each in queued].index(begun.task_id)]:
            if name in self.state.abilities().of(ahead.task_type, ahead.target):
                planned = whole.find(ahead.task_id)
                own = line_plan(robots[name], ahead.task_type, ahead.target, robots[name].pose)
                assert planned.robot != name
                assert planned.ends <= self.now + own.seconds

    @rule(name=st.sampled_from(NAMES), outcome=st.sampled_from(["SUCCEEDED", "FAILED"]))
    def end(self, name, outcome):
        begun, self.executes[name] = self.executes[name], None
        if begun is not None:
            ended = begun.ended(TaskState(outcome), self.now)
            try:
                rules.update(self.state, self.now, name, self.epochs[name], ended, pose(1))
            except rules.Fenced:
                assert self.state.tasks[begun.task_id].state is not TaskState(outcome)

    @rule(name=st.sampled_from(NAMES))
    def renew(self, name):
        try:
            rules.renew(self.state, self.now, name, self.epochs[name], LEASE)
            self.until[name] = self.now + LEASE
        except rules.Fenced:
            self.executes[name] = None  # the server halts its robot

    @rule(name=st.sampled_from(NAMES))
    def come_back(self, name):
        if not self.state.robots[name].is_live(self.now):
            self.join(name)

    @rule(seconds=st.sampled_from([0.5, 2.0, 7.0]))
    def wait(self, seconds):
        self.now += seconds
        for name in self.NAMES:
            if not self.may_drive(name):
                self.executes[name] = None  # it halts by its own clock

    @precondition(lambda self: self.submitted)
    @rule(data=st.data())
    def cancel_or_requeue(self, data):
        number = data.draw(st.sampled_from(sorted(self.submitted)))
        if self.state.tasks[number].state.is_ended:
            if requeue(self.state, self.now, number, resume=False).success:
                self.begun.pop(number, None)
        else:
            cancel(self.state, self.now, number, "")

    @invariant()
    def no_task_is_lost(self):
        assert set(self.state.tasks) == self.submitted

    @invariant()
    def no_task_runs_twice(self):
        assert all(count == 1 for count in self.begun.values())
        driving = [
            begun.task_id
            for name, begun in self.executes.items()
            if begun is not None and self.may_drive(name)
        ]
        assert len(driving) == len(set(driving))

    @invariant()
    def robots_and_tasks_agree(self):
        held = {each.task_id: each.name for each in self.state.robots.values() if each.task_id}
        begun = {number: self.state.tasks[number].robot for number in self.state.begun}
        assert held == begun


Interleavings.TestCase.settings = settings(
    max_examples=examples(100), stateful_step_count=50, deadline=None
)
TestInterleavings = Interleavings.TestCase
