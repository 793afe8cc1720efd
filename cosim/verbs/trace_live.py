def play():
    pass


def view():
    pass
