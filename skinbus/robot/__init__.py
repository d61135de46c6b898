"""The robot under the skin: links and joints from a URDF, contacts in its frames, torques in its joints."""

from skinbus.robot.chain import Chain, compile_chain
from skinbus.robot.frames import RobotContacts, RobotFrames
from skinbus.robot.urdf import Joint, read_urdf

__all__ = ["Chain", "Joint", "RobotContacts", "RobotFrames", "compile_chain", "read_urdf"]
