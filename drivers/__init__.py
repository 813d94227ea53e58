"""How to talk to each device, and its simulated twin. Knows nothing of grasps.

clock.py      the one notion of time, monotonic or virtual
errors.py     the error tree of the whole project
wam/          Barrett WAM arm on CAN
dynamixel/    tendon motors on a serial bus
simulated/    twins of the devices that speak the real bytes
"""
