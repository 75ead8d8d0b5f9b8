"""Programs written for dm_control, modelled on well-known ones and run without changes.

A program imports only `dm_control`, runs some steps and prints one line of JSON per result.
`test_clients.py` runs it on Limberjack and on the real dm_control and compares the lines.
"""
