"""Options of the whole suite."""


def pytest_addoption(parser):
    parser.addoption("--figures", help="file that what the fault tests measure is written to")
    parser.addoption("--rows", help="only fault rows whose name has these words; or; these")
