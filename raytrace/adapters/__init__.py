"""The interfaces of other libraries, answered by this one."""
