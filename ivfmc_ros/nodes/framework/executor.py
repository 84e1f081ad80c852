# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executor of a node that collects what it waits for when that changes, not at each wake.

rclpy's SingleThreadedExecutor collects all entities of its nodes and makes a wait set, in Python,
twice for each callback; in a cell where nothing happens that is most of what a node costs. Here
timers and subscriptions, which wake a node all the time, are called at once. What is rare is left
to rclpy: services, clients, event handlers, guard conditions and coroutines. rclpy's own
EventsExecutor is no choice: up to Jazzy's 7.1.10 it cannot call a coroutine of a service, and an
exception in a task ends the process.
"""

from collections.abc import Callable
from contextlib import ExitStack
import inspect
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.executors import ShutdownException
from rclpy.executors import SingleThreadedExecutor
from rclpy.executors import TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import timeout_sec_to_nsec
from rclpy.waitable import NumberOfEntities

from ivfmc_ros.nodes.framework.heartbeats import FetchedGroup

_TIMERS, _SUBSCRIPTIONS, _SERVICES, _CLIENTS = 'timer', 'subscription', 'service', 'client'
_GUARDS = 'guard_condition'
# In the order of the arguments of NumberOfEntities.
_COUNTED = (_SUBSCRIPTIONS, _GUARDS, _TIMERS, _CLIENTS, _SERVICES)


class _Entities:
    """
    What the nodes of an executor wait for, and a wait set of that size.

    by_kind : entities by the address of their handle, by their kind
    coroutines : timers and subscriptions whose callback is one
    """

    def __init__(self, executor: SingleThreadedExecutor, held: ExitStack) -> None:
        """``held`` : keeps the handles until it is closed; a destroyed one would not be valid."""
        self.by_kind: dict[str, dict[int, Any]] = {}
        nodes = executor.get_nodes()
        for kind, attribute in (
            (_SUBSCRIPTIONS, 'subscriptions'),
            (_TIMERS, 'timers'),
            (_SERVICES, 'services'),
            (_CLIENTS, 'clients'),
            (_GUARDS, 'guards'),
        ):
            entities = [entity for node in nodes for entity in getattr(node, attribute)]
            found = [
                entity
                for entity in entities
                if not isinstance(entity.callback_group, FetchedGroup)
                and _is_held(held, entity.handle)
            ]
            self.by_kind[kind] = {entity.handle.pointer: entity for entity in found}
        called = [*self.by_kind[_TIMERS].values(), *self.by_kind[_SUBSCRIPTIONS].values()]
        self.coroutines = {one for one in called if inspect.iscoroutinefunction(one.callback)}
        found = [waitable for node in nodes for waitable in node.waitables]
        self._waitables = [waitable for waitable in found if _is_held(held, waitable)]
        self._awaited: list[Any] = []
        # those of the executor: woken by another thread, or by a signal that rclpy handles
        self._own_guards = [executor._guard.handle, executor._sigint_gc.handle]
        self._own = {handle.pointer for handle in self._own_guards}
        self._wait_set = self._make_wait_set(executor.context.handle)
        self._adding = [
            (add, [(entity, entity.handle) for entity in self.by_kind[kind].values()])
            for kind, add in (
                (_SUBSCRIPTIONS, self._wait_set.add_subscription),
                (_TIMERS, self._wait_set.add_timer),
                (_SERVICES, self._wait_set.add_service),
                (_CLIENTS, self._wait_set.add_client),
                (_GUARDS, self._wait_set.add_guard_condition),
            )
        ]

    def _make_wait_set(self, context: Any) -> Any:
        counts = NumberOfEntities(*(len(self.by_kind[kind]) for kind in _COUNTED))
        counts.num_guard_conditions += len(self._own_guards)
        for waitable in self._waitables:
            counts += waitable.get_num_entities()
        with context:
            return rclpy_implementation.WaitSet(
                counts.num_subscriptions,
                counts.num_guard_conditions,
                counts.num_timers,
                counts.num_clients,
                counts.num_services,
                counts.num_events,
                context,
            )

    def wait(self, timeout_ns: int, may_run: Callable[[Any], bool] | None) -> None:
        """
        Wait until one of the entities is ready, for at most ``timeout_ns``; negative: for ever.

        may_run : returns whether an entity is waited for; None: all are
        """
        self._wait_set.clear_entities()
        for add, entities in self._adding:
            for entity, handle in entities:
                if may_run is None or may_run(entity):
                    add(handle)
        for handle in self._own_guards:
            self._wait_set.add_guard_condition(handle)
        self._awaited = [w for w in self._waitables if may_run is None or may_run(w)]
        for waitable in self._awaited:
            waitable.add_to_wait_set(self._wait_set)
        self._wait_set.wait(timeout_ns)

    def ready(self, kind: str) -> list[Any]:
        """Return the entities of a kind that are ready."""
        entities = self.by_kind[kind]
        pointers = self._wait_set.get_ready_entities(kind)
        return [entities[pointer] for pointer in pointers if pointer in entities]

    def ready_waitables(self) -> list[Any]:
        """Return the waitables that are ready, of those that were waited for."""
        return [waitable for waitable in self._awaited if waitable.is_ready(self._wait_set)]

    def is_woken(self) -> bool:
        """Return whether a guard condition of the executor was triggered."""
        return not self._own.isdisjoint(self._wait_set.get_ready_entities(_GUARDS))


class NodeExecutor(SingleThreadedExecutor):
    """A SingleThreadedExecutor for nodes that wake often; ``spin_once`` calls what is ready."""

    # of rclpy, up to 7.1.8; others keep the tasks that wait elsewhere
    _tasks: list[Any]

    def __init__(self, **options: Any) -> None:
        """``options`` : of rclpy's Executor."""
        self._entities: _Entities | None = None
        self._held = ExitStack()
        # set by any thread that creates or destroys an entity
        self._is_stale = True
        super().__init__(**options)

    def wake(self) -> None:
        """Wake the executor because entities of a node were created or destroyed."""
        self._is_stale = True
        super().wake()

    def add_node(self, node: Any) -> bool:
        """Manage the callbacks of a node; return whether it is a new one."""
        self._is_stale = True
        return bool(super().add_node(node))

    def remove_node(self, node: Any) -> None:
        """Manage the callbacks of a node no longer."""
        self._is_stale = True
        super().remove_node(node)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End; see rclpy."""
        self._entities, self._is_stale = None, True
        self._held.close()
        return bool(super().shutdown(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """
        Wait for at most ``timeout_sec`` seconds, not where a task ended, and call what is ready.

        An exception of a callback is raised; what else was ready is called the next time.
        """
        task_ended = self._run_tasks()
        if self._has_ended():
            return
        entities = self._collected()
        # a coroutine may hold its group of callbacks
        may_run = self.can_execute if getattr(self, '_tasks', True) else None
        with self._context.handle:
            # what the caller waits for may be the end of a task
            entities.wait(0 if task_ended else timeout_sec_to_nsec(timeout_sec), may_run)
        if not self._has_ended():
            self._call_ready(entities)

    def _has_ended(self) -> bool:
        """:raises ExternalShutdownException: ROS was shut down."""
        if not (self._is_shutdown or self._context.ok()):
            raise ExternalShutdownException
        return bool(self._is_shutdown)

    def _collected(self) -> _Entities:
        if self._is_stale or self._entities is None:
            self._is_stale = False
            self._held.close()
            try:
                self._entities = _Entities(self, self._held)
            except BaseException:
                self._is_stale = True
                raise
        return self._entities

    def _call_ready(self, entities: _Entities) -> None:
        others = bool(entities.ready_waitables())
        for kind in (_SERVICES, _CLIENTS):
            others |= bool(entities.ready(kind))
        for guard in entities.ready(_GUARDS):
            # rclpy triggers it again for its own wait set
            guard._executor_triggered, others = True, True
        # tasks of versions that keep them elsewhere
        others |= entities.is_woken() and not hasattr(self, '_tasks')
        for kind, take in ((_TIMERS, self._take_timer), (_SUBSCRIPTIONS, self._take_subscription)):
            for entity in entities.ready(kind):
                if entity in entities.coroutines:
                    others = True
                elif kind != _TIMERS or _is_due(entity):
                    _call(take(entity))
        if others:
            self._run_others()

    def _run_tasks(self) -> bool:
        """
        Run or resume the tasks, which await futures by being resumed at each wake.

        Once more where one has ended: another may await it.

        returns : whether one has ended
        """
        count = 0
        is_open = bool(getattr(self, '_tasks', ()))
        while is_open:
            with self._tasks_lock:
                tasks = [task for task, _, _ in self._tasks]
            is_open = False
            for task in tasks:
                task()
                if task.done() or task.cancelled():
                    is_open, count = True, count + 1
                    self._forget(task)
        return count > 0

    def _forget(self, task: Any) -> None:
        """Drop a task that has ended, and raise its exception."""
        with self._tasks_lock:
            self._tasks = [item for item in self._tasks if item[0] is not task]
        if task.exception() is not None:
            raise task.exception()

    def _run_others(self) -> None:
        """Let rclpy call what is ready."""
        while True:
            try:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0.0)
            except (TimeoutException, ShutdownException):
                return
            handler()
            if handler.exception() is not None:
                raise handler.exception()


def _is_held(held: ExitStack, handle: Any) -> bool:
    """Keep a handle from being destroyed; return False where it has been."""
    try:
        held.enter_context(handle)
    except InvalidHandle:
        return False
    return True


def _is_due(timer: Any) -> bool:
    """Return whether no callback has canceled or destroyed a timer since it was ready."""
    try:
        return bool(timer.is_ready())
    except InvalidHandle:
        return False


def _call(work: Callable[[], Any] | None) -> None:
    """Run what rclpy makes of a callback: a coroutine that awaits nothing."""
    if work is None:
        return
    coroutine = work()
    try:
        coroutine.send(None)
    except StopIteration:
        return
    coroutine.close()
