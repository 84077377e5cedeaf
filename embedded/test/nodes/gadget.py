"""A node with parameters, a service, a topic and something to do at the end."""

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool


class Gadget(Node):
    def __init__(self):
        super().__init__('gadget')
        gain = FloatingPointRange(from_value=0.0, to_value=10.0)
        self.declare_parameter(
            'gain', 1.5, ParameterDescriptor(description='V/A', floating_point_range=[gain])
        )
        count = IntegerRange(from_value=0, to_value=100, step=5)
        self.declare_parameter('count', 10, ParameterDescriptor(integer_range=[count]))
        self.declare_parameter('device', 'daq0', ParameterDescriptor(read_only=True))
        self.declare_parameter('filter.window', 4)
        self.declare_parameter('names', ['LF', 'RF'])
        self.add_on_set_parameters_callback(self.validate)
        self.publisher = self.create_publisher(String, 'state', 10)
        self.create_service(SetBool, '~/enable', self.enable)
        self.create_timer(0.02, self.tick)
        self.told = False

    def tick(self):
        self.publisher.publish(String(data='idle'))
        if not self.told:
            self.told = True
            device = self.get_parameter('device').value
            print(f'ready {self.get_fully_qualified_name()} {device}', flush=True)

    def validate(self, parameters):
        for parameter in parameters:
            if parameter.name == 'filter.window' and parameter.value % 2:
                return SetParametersResult(successful=False, reason='the window must be even')
            print(f'applied {parameter.name}={parameter.value}', flush=True)
        return SetParametersResult(successful=True)

    def enable(self, request, response):
        response.success = request.data
        response.message = 'on' if request.data else 'off'
        return response


def main():
    rclpy.init()
    node = Gadget()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException) as end:
        print(f'ended by {type(end).__name__}', flush=True)
    except RuntimeError:
        if rclpy.ok():
            raise
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
        print('cleaned up', flush=True)


if __name__ == '__main__':
    main()
