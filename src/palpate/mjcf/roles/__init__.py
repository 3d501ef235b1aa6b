"""Roles of a document's elements: objects, surfaces and robots.

A body with a free joint is an object; a static named body or geom that may carry things is a
surface; an articulated body that is driven, or ends in a hand, is a robot and neither.
"""
