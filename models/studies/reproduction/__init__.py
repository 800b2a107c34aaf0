"""A published study of stiction networks, reproduced, and our own NARX on the same cases.

H. Zabiri, Y. Samyudia and W. N. W. M. Zainudin, "Neural network modeling of valve stiction
dynamics". Everything here is free of noise: the question is what a network can learn of a
stick-slip element at all, not how well it follows a real valve.
"""
