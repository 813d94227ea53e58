"""All that is worked out before the robot moves: hand mechanics, grasps, motion tables.

hand/             parameter files, fingers
objects/          shapes and the objects' files
grasp/            specification, first contact, contact, equilibrium, paths of equilibria
build.py          hand × object × grasp → table
motion_table.py   the table: what it holds and how it is looked up
table_grid.py     one C¹ grid of it
table_file.py     its bytes, on disk and in sealed memory
toml_files.py     TOML → frozen structs, with errors that say what is wrong
"""
