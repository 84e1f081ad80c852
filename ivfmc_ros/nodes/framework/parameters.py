# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameters of a node: typed, described, with ranges, and checked together before they are set.

A rejected value names the parameter and the reason. The fields of a settings dataclass become
parameters with the descriptions of its docstring.
"""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import fields
from dataclasses import is_dataclass
from dataclasses import replace
import math
import re
from typing import Any
from typing import get_type_hints
from typing import TypeVar

from rcl_interfaces.msg import FloatingPointRange
from rcl_interfaces.msg import IntegerRange
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.json_response import describe
from ivfmc_ros.validation import suggestion

# Namespace of a cell unless the command line names another.
NAMESPACE = '/ivfmc'

Settings = TypeVar('Settings')
Check = Callable[[Mapping[str, Any]], None]

_ARRAYS = {
    bool: Parameter.Type.BOOL_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    float: Parameter.Type.DOUBLE_ARRAY,
    str: Parameter.Type.STRING_ARRAY,
}


class ParameterNode(Node):
    """A node whose parameters are checked before they are set."""

    def __init__(self, name: str) -> None:
        super().__init__(name, namespace=NAMESPACE)
        self._choices: dict[str, tuple[Any, ...]] = {}
        self._unbounded: set[str] = set()
        self._checks: list[Check] = []
        self.add_on_set_parameters_callback(self._validate)

    def parameter(  # noqa: PLR0913 - one argument a property
        self,
        name: str,
        default: Any,
        description: str,
        *,
        low: float | None = None,
        high: float | None = None,
        choices: Sequence[Any] | None = None,
        read_only: bool = False,
        kind: type | None = None,
        constraints: str = '',
    ) -> Any:
        """
        Declare a parameter and return its value.

        low, high : inclusive bounds; both or none
        choices : the values that are allowed
        kind : type of the elements where ``default`` is an empty list; int for a string that may
            be given as an integer
        constraints : text for the descriptor: what ``check`` rejects
        :raises ParameterError: the value of the command line or parameter file is invalid
        """
        if choices is not None:
            self._choices[name] = tuple(choices)
            constraints = constraints or f'one of {", ".join(map(str, choices))}'
        if high is not None and math.isinf(high):
            self._unbounded.add(name)
        descriptor = ParameterDescriptor(
            description=description,
            read_only=read_only,
            additional_constraints=constraints,
        )
        if low is not None and high is not None:
            _set_range(descriptor, default, low, high)
        try:
            self._declare(name, default, descriptor, kind)
        except Exception as error:
            raise ParameterError(f'{self.get_name()}: parameter {name}: {error}') from error
        return self.get(name)

    def _declare(
        self, name: str, default: Any, descriptor: ParameterDescriptor, kind: type | None
    ) -> None:
        given = self._parameter_overrides.get(name)
        if isinstance(default, list | tuple):
            array = _ARRAYS[kind or type(default[0])]
            # rclpy takes an empty list for a byte array
            self.declare_parameter(name, array, descriptor)
            if not self.get_parameter_or(name, Parameter(name)).value:
                # an empty list in a parameter file has no type
                value = [] if given is not None else list(default)
                self.set_parameters([Parameter(name, array, value)])
            return
        if given is not None and given.type_ is Parameter.Type.INTEGER:
            # accept 2 for 2.0 or '2', which rclpy rejects
            number = float if isinstance(default, float) else str if kind is int else int
            self._parameter_overrides[name] = Parameter(name, value=number(given.value))
        self.declare_parameter(name, default, descriptor)

    def get(self, name: str) -> Any:
        """Return the value of a parameter; arrays as a list."""
        value = self.get_parameter(name).value
        plain = value is None or isinstance(value, bool | int | float | str)
        return value if plain else list(value)

    def check(self, function: Check) -> None:
        """
        Call ``function`` with all values by name before any of them is changed.

        A ScanError that it raises rejects the change; its text becomes the reason.
        """
        self._checks.append(function)

    def changed(self, function: Callable[[set[str]], None]) -> None:
        """Call ``function`` with the names of the parameters after they have been set."""
        self.add_post_set_parameters_callback(
            lambda parameters: function({parameter.name for parameter in parameters})
        )

    def settings(
        self,
        defaults: Settings,
        prefix: str = '',
        ranges: Mapping[str, tuple[float, float]] | None = None,
        only: tuple[str, ...] = ('',),
    ) -> Callable[[], Settings]:
        """
        Declare every field of a frozen dataclass, nested ones with dotted names.

        Descriptions come from its docstring ('name : text'). For a field that may be None, the
        parameter value 0.0 means None.

        prefix : prepended to every name
        ranges : name -> (low, high), for the descriptors; ``__post_init__`` is checked in any case
        only : prefixes of the names that are declared; other fields keep their default
        returns : a function that builds the dataclass from the current parameter values
        :raises ParameterError: values of the command line are rejected by ``__post_init__``
        """
        found = _leaves(defaults, prefix)
        leaves = {name: leaf for name, leaf in found.items() if name.startswith(only)}
        for name, (default, description) in leaves.items():
            low, high = (ranges or {}).get(name, (None, None))
            value = 0.0 if default is None else default
            constraints = 'checked together with the other fields of its group'
            self.parameter(name, value, description, low=low, high=high, constraints=constraints)

        def build(values: Mapping[str, Any]) -> Settings:
            return _built(defaults, prefix, values)

        def current() -> Settings:
            return build({name: self.get(name) for name in leaves})

        def check(values: Mapping[str, Any]) -> None:
            build({name: values[name] for name in leaves})

        current()
        self.check(check)
        return current

    def unknown_parameters(self) -> list[str]:
        """Return a line for each parameter given at the start that the node does not declare."""
        known = sorted(self._parameters)
        lines = []
        for name in sorted(set(self._parameter_overrides) - set(known)):
            if not name.startswith('qos_overrides.'):
                hint = suggestion(name, known)
                lines.append(f'parameter {name!r} is unknown to {self.get_name()}{hint}')
        return lines

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            for parameter in parameters:
                self._require_valid(parameter.name, parameter.value)
            if self._checks:
                values = {name: self.get(name) for name in self._parameters}
                values.update({p.name: p.value for p in parameters})
                for function in self._checks:
                    function(values)
        except ScanError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:  # the caller would get no answer at all
            return SetParametersResult(successful=False, reason=describe(error))
        return SetParametersResult(successful=True)

    def _require_valid(self, name: str, value: Any) -> None:
        numbers = value if not isinstance(value, str | bytes | None) else ()
        for number in numbers if hasattr(numbers, '__iter__') else (numbers,):
            finite = not isinstance(number, float) or math.isfinite(number)
            unbounded = name in self._unbounded and number == math.inf
            if not finite and not unbounded:
                raise ParameterError(f'{name}: {number} is not a finite number')
        allowed = self._choices.get(name)
        if allowed is not None and value not in allowed:
            known = ', '.join(map(str, allowed))
            raise ParameterError(f'{name}: {value!r} is not one of {known}')


def _set_range(descriptor: ParameterDescriptor, default: Any, low: float, high: float) -> None:
    if isinstance(default, float):
        bounds = FloatingPointRange(from_value=float(low), to_value=float(high))
        descriptor.floating_point_range = [bounds]
    elif isinstance(default, int) and not isinstance(default, bool):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]


def _leaves(settings: Any, prefix: str) -> dict[str, tuple[Any, str]]:
    """Return default and description of every field that is no dataclass, by dotted name."""
    descriptions = _descriptions(type(settings))
    kinds = get_type_hints(type(settings))
    found: dict[str, tuple[Any, str]] = {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        name = f'{prefix}{field.name}'
        if is_dataclass(value):
            found.update(_leaves(value, f'{name}.'))
        elif isinstance(value, bool | int | float | str) or kinds[field.name] == float | None:
            text = descriptions.get(field.name, _first_line(type(settings)))
            found[name] = (value, text if value is not None else text.replace('None', '0'))
    return found


def _built(defaults: Settings, prefix: str, values: Mapping[str, Any]) -> Settings:
    changes: dict[str, Any] = {}
    for field in fields(defaults):  # type: ignore[arg-type]
        value = getattr(defaults, field.name)
        name = f'{prefix}{field.name}'
        if is_dataclass(value):
            changes[field.name] = _built(value, f'{name}.', values)
        elif name in values:
            unset = value is None and values[name] == 0.0
            changes[field.name] = None if unset else values[name]
    return replace(defaults, **changes)  # type: ignore[type-var]


def _first_line(kind: type) -> str:
    text = (kind.__doc__ or kind.__name__).strip()
    return ' '.join(text.split('\n\n')[0].split())


def _descriptions(kind: type) -> dict[str, str]:
    """Parse 'name, other : text' lines, with indented continuation lines, of a docstring."""
    found: dict[str, str] = {}
    pattern = r'^ {4}(\w+(?:, \w+)*) : (.*(?:\n {6,}\S.*)*)'
    for names, text in re.findall(pattern, kind.__doc__ or '', re.MULTILINE):
        found.update(dict.fromkeys(names.split(', '), ' '.join(text.split())))
    return found
