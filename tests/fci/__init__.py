"""A Franka over libfranka's own protocol, in palpate's hidden world: what `robots/franky` is tested
against where there is no hardware.

    with served("scene.xml", "world.xml", noise="lab", seed=0) as bench:
        robot = franky.Robot(bench.address, realtime_config=franky.RealtimeConfig.Ignore)
        bench.ask("truth", name="bottle.mass")

A process of its own serves it (`python -m tests.fci`), one thread, one control cycle at a time.
"""
