"""Options of the whole suite."""


def pytest_addoption(parser):
    parser.addoption("--figures", help="file that what the fault tests measure is written to")
