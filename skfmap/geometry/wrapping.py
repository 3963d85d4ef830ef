def wants_wrapping(v, f):
    return ""


def wrap(*a):
    raise NotImplementedError
