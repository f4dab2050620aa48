from config.settings import Settings
from perception.warm_up import warm_up_estimation, warm_up_tracking


def test_the_drawn_rotor_takes_every_method_through_to_an_answer():
    warm_up_tracking()
    for method in ("rotor_fit", "fermat"):
        settings = Settings.model_validate({"estimation": {"method": method}})
        assert warm_up_estimation(settings)
