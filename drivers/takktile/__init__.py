"""TakkTile tactile pads: barometers under rubber, behind a USB bridge.

frames.py         requests, addresses, scans and bulk frames of both bridge firmwares (pure)
compensation.py   what a cell's raw words mean (pure)
transport.py      the seam between the bridge and what carries it
usb.py            the bridge on USB, through pyusb
bridge.py         one bridge: which firmware, which cells, sampling on and off
calibration.py    what is known of one finger's pad: its cells, gains, thermal drift
quality.py        which cells of a frame can be believed, and what is wrong with the others
pads.py           frames to force per finger: zero, drift, cells that do not count
touch.py          whether a finger touches, and since when
"""
