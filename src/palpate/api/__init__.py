"""The front door: a scene, a plan and a run, each with the verbs that lead to the next.

    scene = pp.load("desk.xml")
    plan = scene.plan("how heavy is the mug?")
    run = plan.run(seed=0)

`Scene`, `Plan` and `Run` are the inner classes plus verbs that call the pipeline, so that inner rooms
never import upwards and there is no second scene.
"""
