"""The daemon: the 500 Hz cycle and what starts, commands, watches and shows it.

cycle/        all that runs in the 2 ms, and nothing else; cycle.py reads in one screen
service/      all around it: processes, links, commands, state, recordings
simulation/   a MuJoCo world behind the simulated devices; virtual time
messages.py   what the processes say to each other
config.py     robot.toml        client.py  what a task planner imports        cli.py  the command line
"""
