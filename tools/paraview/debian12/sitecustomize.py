"""ParaView 5.11.0, as Debian 12 has it, cannot load any plugin in Python: it uses inspect.getargspec, which Python 3.11 no
longer has. With this folder in PYTHONPATH it can."""
import inspect

if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec
