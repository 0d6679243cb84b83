"""The columns of the log contract: what a log may have, whatever a file calls it."""

SINGLE_COMMANDS = ("torque", "force", "current", "voltage", "duty", "setpoint")
TORQUES_OF_TWO, CURRENTS_OF_TWO = ("torque_1", "torque_2"), ("current_1", "current_2")
"""The columns of two motors; one of them alone is no command."""
COMMANDS = (*SINGLE_COMMANDS, *TORQUES_OF_TWO, *CURRENTS_OF_TWO)
RESPONSES = ("angle", "position", "velocity")
COLUMNS = (
    *("time", "torque", *TORQUES_OF_TWO, "force", "current", *CURRENTS_OF_TWO, "voltage", "duty", "setpoint"),
    *("kp", "kd"),
    *("angle", "position", "velocity", "angle_1", "angle_2", "reference", "run"),
    *("payload_mass", "payload_radius", "payload_inertia", "payload_gravity"),
)
"""All columns; others of a file are ignored."""

ALIASES = {"goal": "setpoint"}
"""Older names of columns, still valid."""
