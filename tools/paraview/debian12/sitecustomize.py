"""ParaView 5.11.0 of Debian 12 cannot load plugins written in Python, because it uses inspect.getargspec, which Python
3.11 no longer has. With this folder in PYTHONPATH it can."""
import inspect

if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec
