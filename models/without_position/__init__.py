"""The evidence of OP and PV alone on a valve without a measured position: a suspicion, no
verdict.
"""
