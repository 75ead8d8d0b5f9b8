"""Programs written for dm_control, in the manner of well-known ones, each run as it stands.

A program imports `dm_control` alone, plays for a while and prints one line of JSON per result.
`test_clients.py` runs it on Limberjack and on the genuine dm_control and compares the lines.
"""
