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

from rclpy.exceptions import (
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_parameters

MISSING = (ParameterNotDeclaredException, ParameterUninitializedException)


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

    def _describe(self, request: Any, response: Any) -> Any:
        for name in request.names:
            try:
                response.descriptors.append(self._node.describe_parameter(name))
            except ParameterNotDeclaredException:
                response.descriptors = [ParameterDescriptor()]
                break
        return response

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

    def _get(self, request: Any, response: Any) -> Any:
        response.values = self._values(request.names)
        return response

    def _types(self, request: Any, response: Any) -> Any:
        response.types = [value.type for value in self._values(request.names)]
        return response

    def _list(self, request: Any, response: Any) -> Any:
        response.result = self._node.list_parameters(list(request.prefixes), request.depth)
        return response

    def _set(self, request: Any, response: Any) -> Any:
        for message in request.parameters:
            response.results.append(self._apply([message]))
        return response

    def _set_atomically(self, request: Any, response: Any) -> Any:
        response.result = self._apply(list(request.parameters))
        return response

    def _apply(self, messages: list[Any]) -> Any:
        try:
            parameters = [Parameter.from_parameter_msg(message) for message in messages]
            return self._node.set_parameters_atomically(parameters)
        except (*MISSING, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
