"""One message of each type that is on a topic of the suite, with contents to recognise it by."""

from array import array

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Imu, JointState

from drive_power_msgs.msg import DriveSupply, PowerEstimate


def joint_states():
    message = JointState(name=['LF_HAA', 'LF_HFE'], position=[0.1, -0.2])
    message.header.stamp.sec, message.header.stamp.nanosec = 7, 8
    message.velocity = array('d', [1.0, 2.0])
    message.effort = [30.0, -40.0]
    return message


def drive_supply():
    message = DriveSupply(name=['LF_HAA', 'LF_HFE'], sequence=2**40, status=array('B', [0, 4]))
    message.header.frame_id = 'board'
    message.device_time = array('Q', [2**41])
    message.voltage, message.current = array('f', [48.0, 47.5]), array('f', [1.5, -0.25])
    message.temperature = array('f', [float('nan'), 41.0])
    return message


def power_estimate():
    power = array('f', [10.5, 20.25])
    return PowerEstimate(model='ppn:x', name=['a', 'b'], power=power, total=30.75, status=1)


def diagnostics():
    values = [KeyValue(key='rate', value='1000')]
    status = DiagnosticStatus(level=bytes([2]), name='bus', message='lost', values=values)
    return DiagnosticArray(status=[status, DiagnosticStatus(level=DiagnosticStatus.OK)])


def supply():
    return BatteryState(voltage=48.0, current=-8.0, charge=float('nan'), present=True)


def imu():
    message = Imu()
    message.orientation.w, message.angular_velocity.z = 1.0, 0.5
    message.orientation_covariance = [0.0] * 8 + [2.0]
    return message


def odom():
    message = Odometry(child_frame_id='base')
    message.pose.pose.position.x = 1.5
    message.twist.twist.linear.y = -0.5
    return message


def cmd_vel():
    message = TwistStamped()
    message.twist.linear.x, message.twist.angular.z = 0.5, -0.25
    return message


def clock():
    message = Clock()
    message.clock.sec, message.clock.nanosec = 3, 4
    return message


MESSAGES = {
    make.__name__: make
    for make in (
        joint_states,
        drive_supply,
        power_estimate,
        diagnostics,
        supply,
        imu,
        odom,
        cmd_vel,
        clock,
    )
}
"""By topic: what makes its message."""
