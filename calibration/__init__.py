"""All that is worked out before the robot moves: hand mechanics, grasps, motion tables.

hand/             parameter files, joints, fingers
objects/          shapes and the objects' files
grasp/            contact, equilibrium, preposition
motion_table.py   the table: file format and look-up
build.py          hand × object × grasp → table
"""
