"""The planar arm of the manipulator and the stacker: kinematics, collisions and paths."""
