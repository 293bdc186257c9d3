"""Driver of another package, for a bus."""

from equipoise import Driver

DRIVER = Driver(
    name="outside-bus",
    what="robots on another vendor's bus",
    start="lie it down, switch it on",
    page="https://example.org/outside-bus",
    module="outside_driver.link",
    settings="outside_driver.settings:BusSettings",
)
