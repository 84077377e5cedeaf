"""The exceptions that rclpy takes from its compiled part, at the place where it has them."""


class RCLError(RuntimeError):
    """Raised when the middleware or the ROS client library fails."""


class RCLInvalidROSArgsError(RCLError):
    """Raised when arguments after --ros-args cannot be read."""


class UnknownROSArgsError(RuntimeError):
    """Raised when there are unknown arguments after --ros-args."""


class InvalidHandle(Exception):  # noqa: N818
    """Raised when an entity is used after it was destroyed."""

    def __init__(self) -> None:
        super().__init__('cannot use Destroyable because destruction was requested')
