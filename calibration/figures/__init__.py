"""The counterparts of the paper's figures, drawn from the models.

atlas.py          which figures there are, and writing them
paper_figure.py   one figure: picture, caption, values
style.py          sizes, type, colours
drawing.py        hand and object at a state
closing.py        Fig. 2: free closing to first contact
reconfiguration.py  Fig. 3 and 4: how the hand moves the object, and what may end it
stiffness_ratio.py  Fig. 6
compensation.py   Fig. 7: the wrist and the arm that keep the object still
force_curves.py   Fig. 10 and 13: forces and motion over winding
object_path.py    Fig. 15
weight.py         Fig. 16: the support's friction
effort.py         Fig. 17: minimal effort and the most motion
"""
