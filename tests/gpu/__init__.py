"""Tests of limberjack.gpu on Warp's CPU device; `make test-gpu` installs what they need."""
