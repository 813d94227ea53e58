"""All that is worked out before the robot moves: hand mechanics, grasps, motion tables.

hand/             parameter files; joints, tendons and fingers
objects/          shapes and the objects' files
grasp/            first contact, contacts, equilibria, paths, friction, stability, forces, plans
build*.py         hand × object × grasp → table
motion_table.py   the table: what it holds and how it is looked up
table_grid.py     one C¹ grid of it
table_file.py     its bytes, on disk and in sealed memory
table_inputs.py   what a table was made of
catalogue.py      many tables, over any executor
cluster.py        the executors: a process pool, many machines
figures/          the counterparts of the paper's figures
gravity*.py       gravity vectors of the arm: plan, checks, fit
toml_files.py     TOML → frozen structs, with errors that say what is wrong
"""
