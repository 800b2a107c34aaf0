"""Networks that are compared with the stiction models: trained and scored on a recording by one
call.
"""
