"""The robot under the skin: links and joints from a URDF, contacts in its frames, torques in its joints."""

from skinbus.robot.frames import RobotContacts, RobotFrames

__all__ = ["RobotContacts", "RobotFrames"]
