"""The services by which others read and set a node's parameters."""

from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterValue, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)

from rclpy.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_parameters


class ParameterService:
    """Serves `~/get_parameters` and its five companions."""

    def __init__(self, node: Any):
        self._node = node
        for srv_type, name, callback in (
            (DescribeParameters, 'describe_parameters', self._describe),
            (GetParameters, 'get_parameters', self._get),
            (GetParameterTypes, 'get_parameter_types', self._types),
            (ListParameters, 'list_parameters', self._list),
            (SetParameters, 'set_parameters', self._set),
            (SetParametersAtomically, 'set_parameters_atomically', self._set_atomically),
        ):
            node.create_service(
                srv_type, f'~/{name}', callback, qos_profile=qos_profile_parameters
            )

    def _describe(self, request: Any, _: Any) -> Any:
        try:
            found = [self._node.describe_parameter(name) for name in request.names]
        except ParameterNotDeclaredException:
            found = [ParameterDescriptor()]
        return DescribeParameters.Response(descriptors=found)

    def _values(self, names: list[str]) -> list[Any]:
        """Return ParameterValues, of type NOT_SET without a value; none if one is undeclared."""
        values = []
        for name in names:
            try:
                values.append(self._node.get_parameter(name).get_parameter_value())
            except ParameterUninitializedException:
                values.append(ParameterValue())
            except ParameterNotDeclaredException:
                return []
        return values

    def _get(self, request: Any, _: Any) -> Any:
        return GetParameters.Response(values=self._values(request.names))

    def _types(self, request: Any, _: Any) -> Any:
        types = [value.type for value in self._values(request.names)]
        return GetParameterTypes.Response(types=types)

    def _list(self, request: Any, _: Any) -> Any:
        result = self._node.list_parameters(list(request.prefixes), request.depth)
        return ListParameters.Response(result=result)

    def _set(self, request: Any, _: Any) -> Any:
        results = [self._apply([message]) for message in request.parameters]
        return SetParameters.Response(results=results)

    def _set_atomically(self, request: Any, _: Any) -> Any:
        return SetParametersAtomically.Response(result=self._apply(list(request.parameters)))

    def _apply(self, messages: list[Any]) -> Any:
        try:
            parameters = [Parameter.from_parameter_msg(message) for message in messages]
            return self._node.set_parameters_atomically(parameters)
        except (ParameterNotDeclaredException, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
