"""Topic `card`: what a source knows of its own samples, latched, for the card of a recording."""

from collections.abc import Callable
from typing import Final

from power_recordings.card import Card
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from wattwalk_core.errors import InputError

TOPIC: Final = 'card'
_LATCHED: Final = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
_SOURCES: Final = 10  # nodes whose cards may come at once


def publish_card(node: Node, card: Card) -> None:
    """Publish the entries of a card on topic `card`; it stays for subscribers that come later."""
    node.create_publisher(String, TOPIC, _LATCHED).publish(String(data=card.text()))


def subscribe_to_cards(node: Node, take: Callable[[Card], None]) -> None:
    """Call take with each source's card, earlier ones included; log one that cannot be read."""

    def on_card(message: String) -> None:
        try:
            card = Card.parse(message.data, f'topic {TOPIC}')
        except InputError as error:
            node.get_logger().warning(f'{error}; it is left out of the card')
            return
        take(card)

    qos = QoSProfile(
        depth=_SOURCES, reliability=_LATCHED.reliability, durability=_LATCHED.durability
    )
    node.create_subscription(String, TOPIC, on_card, qos)
